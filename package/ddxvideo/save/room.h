/* SPDX-License-Identifier: GPL-2.0-or-later */
/* How much more can be recorded. Opens no lock and waits for the disk only. */
#ifndef DDXVIDEO_ROOM_H
#define DDXVIDEO_ROOM_H

#include <stdint.h>

struct room {
    uint64_t free;  /* free bytes of the file system */
    uint64_t usable; /* bytes that recordings can still take: of these, and of the pool's files without a recording */
    uint32_t ready; /* files of the pool that are prepared, the one that has just been begun among them */
};

/* Of a folder, or of a file's: 0 or -errno. */
int room_look(const char *place, struct room *room);

#endif
