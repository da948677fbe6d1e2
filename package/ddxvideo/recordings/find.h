/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Finds the recordings in a folder, by the indexes of its pool; a file without an index is read itself. */
#ifndef DDXVIDEO_FIND_H
#define DDXVIDEO_FIND_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#include "index.h"

/* A recording has the last of its files' states, in this order. */
enum found_state {
    FOUND_FINISHED,
    FOUND_RECOVERED,   /* finished by a later recorder, after the last complete frame */
    FOUND_CUT_OFF,     /* without an index: the last frame is incomplete, or still being written */
    FOUND_INTERRUPTED, /* no recorder writes it, and none has finished it yet */
    FOUND_RECORDING
};

struct found {
    char name[NAME_MAX + 1];  /* its name now, or when it is finished */
    char shown[NAME_MAX + 1]; /* the name as found_clean() makes it, for messages */
    char item[128];
    uint32_t number;  /* of the file */
    uint32_t session; /* number of the first file of its recording */
    enum found_state state;
    long id;            /* in the pool; 0: no index */
    bool spoilt;        /* its index is damaged */
    uint64_t recording; /* random number in its index, different for each recording */
    uint64_t frames, bytes;
    uint64_t lost_store, lost_ring, lost_encode; /* from its index */
    int64_t wall;                                /* of the first frame, ns; 0: unknown */
    int64_t duration;                            /* ns */
};

struct folder {
    int fd;   /* of the folder */
    int pool; /* of the pool in it; -1: there is none */
    struct found *file;
    unsigned count;
};

/* Find the files of a folder, in the order of their recording. 0 or -errno. Call folder_close() in any case. */
int folder_open(struct folder *folder, const char *path);
void folder_close(struct folder *folder);

/* Make a name printable: the recorder's user chooses names, and none of them may control root's terminal. */
void found_clean(char *text);

/* "finished" and so on. */
const char *found_state_name(enum found_state state);

/* A file that is open for reading. */
struct found_use {
    int fd, index_fd; /* index_fd: -1: it has none */
    int hold;         /* while it is open, the file is not given up or used again; -1: see found_is_given_up() */
    bool direct;      /* opened past the page cache: reads must be aligned */
};

/*
 * Open a file, its index, and hold it, unless nothing needs to be held, or this user may not hold files. 0; -EBUSY: it
 * is being given up right now; or -errno. Call found_close() in any case.
 */
int found_open(const struct folder *folder, const struct found *found, struct found_use *use);
void found_close(const struct found_use *use);

/*
 * Whether its index is of another recording by now, or of none: then bytes that were read may be of either. It may have
 * been given up before it was opened, and without a hold at any time.
 */
bool found_is_given_up(const struct found_use *use, const struct found *found);

#endif
