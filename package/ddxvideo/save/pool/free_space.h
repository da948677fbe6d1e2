/* SPDX-License-Identifier: GPL-2.0-or-later */
/* How much more can be recorded. Opens no lock and waits for the disk only. */
#ifndef DDXVIDEO_FREE_SPACE_H
#define DDXVIDEO_FREE_SPACE_H

#include <stdint.h>

struct free_space {
    uint64_t free;  /* free bytes of the file system */
    uint64_t usable; /* bytes that recordings can still take: of these, and of the pool's files without a recording */
    uint32_t ready; /* files of the pool that are prepared, the one that has just been begun among them */
};

/* Of a folder, or of a file's: 0 or -errno. */
int free_space_look(const char *place, struct free_space *room);

#endif
