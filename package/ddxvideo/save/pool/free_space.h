/* SPDX-License-Identifier: GPL-2.0-or-later */
/* How much more can be recorded. Takes no lock, and waits for nothing but the disk. */
#ifndef DDXVIDEO_FREE_SPACE_H
#define DDXVIDEO_FREE_SPACE_H

#include <stdint.h>

struct free_space {
    uint64_t free;     /* free bytes of the file system */
    uint64_t usable;   /* bytes for recordings: of the free ones, and of the pool's files without a recording */
    uint64_t prepared; /* bytes of these files of the pool, which are not free */
    uint32_t ready;    /* prepared files of the pool, including one that has just been begun */
};

/* For a folder, or the file system of a file. 0 or -errno. */
int free_space_look(const char *place, struct free_space *room);

#endif
