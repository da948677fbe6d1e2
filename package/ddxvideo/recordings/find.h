/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The recordings in a folder, as the indexes of its pool tell them; of a file without an index what the file says. */
#ifndef DDXVIDEO_FIND_H
#define DDXVIDEO_FIND_H

#include "found.h"
#include "index.h"

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
