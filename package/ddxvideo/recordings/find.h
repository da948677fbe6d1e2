/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The recordings in a folder, as the indexes of its pool tell them; of a file without an index what the file says. */
#ifndef DDXVIDEO_FIND_H
#define DDXVIDEO_FIND_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#include "index.h"

/* In this order one file's state becomes that of its recording: the last one wins. */
enum found_state {
    FOUND_FINISHED,
    FOUND_RECOVERED,   /* finished by a later recorder, behind its last whole frame */
    FOUND_CUT_OFF,     /* without an index: its last frame is not whole, or is still being written */
    FOUND_INTERRUPTED, /* it has no writer, and no recorder has finished it yet */
    FOUND_RECORDING
};

/* A file of a recording. */
struct found {
    char name[NAME_MAX + 1];  /* the one that it has, or will have */
    char shown[NAME_MAX + 1]; /* the same as found_clean() leaves it, for lines that people read */
    char item[128];
    uint32_t number;  /* of the file */
    uint32_t session; /* number of the first file of its recording */
    enum found_state state;
    long id;     /* in the pool; 0: it has no index */
    bool spoilt; /* it had one */
    uint64_t recording; /* random number in its index: another one is another recording */
    uint64_t frames, bytes;
    uint64_t lost_store, lost_ring; /* as its index says */
    int64_t wall;                   /* of the first frame, ns; 0: unknown */
    int64_t duration;               /* ns */
};

struct folder {
    int fd;   /* of the folder */
    int pool; /* of the pool in it; -1: there is none */
    struct found *file;
    unsigned count;
};

/* Look into a folder: its files in the order in which they were recorded. 0 or -errno. folder_close() in any case. */
int folder_open(struct folder *folder, const char *path);
void folder_close(struct folder *folder);

/* A name as a line may have it: the recorder's user chooses names, and none of them may steer the terminal of root. */
void found_clean(char *text);

/* "finished" and so on. */
const char *found_state_name(enum found_state state);

/* Open the file past the page cache; *direct: reads have to be aligned. -errno. */
int found_open(const struct folder *folder, const struct found *found, bool *direct);

/* Open its index. -errno. */
int found_open_index(const struct folder *folder, const struct found *found);

/*
 * Keep the file from being given up or used again until *hold is closed; -1 if there is nothing to be held, or this
 * user may not hold files (found_is_given_up() notices then). 0, or -EBUSY: it is being given up right now.
 */
int found_hold(const struct folder *folder, const struct found *found, int *hold);

/* By its index: whether another recording has its place by now, or none. What was read before may be either's. */
bool found_is_given_up(int index_fd, const struct found *found);

#endif
