/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Finds the recordings in a folder, by the indexes of its pool; a file without an index is read itself. */
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

/* Find the files of a folder, in the order of their recording. 0 or -errno. Call folder_close() in any case. */
int folder_open(struct folder *folder, const char *path);
void folder_close(struct folder *folder);

/* Make a name printable: the recorder's user chooses names, and none of them may control root's terminal. */
void found_clean(char *text);

/* "finished" and so on. */
const char *found_state_name(enum found_state state);

/* Open the file past the page cache; *direct: reads must be aligned. -errno on failure. */
int found_open(const struct folder *folder, const struct found *found, bool *direct);

/* Open its index. -errno on failure. */
int found_open_index(const struct folder *folder, const struct found *found);

/*
 * Prevent that the file is given up or used again until *hold is closed; *hold is -1 if nothing needs to be held, or if
 * this user may not hold files (then found_is_given_up() notices). 0, or -EBUSY: it is being given up right now.
 */
int found_hold(const struct folder *folder, const struct found *found, int *hold);

/* Whether its index is of another recording by now, or of none: then bytes that were read may be of either. */
bool found_is_given_up(int index_fd, const struct found *found);

#endif
