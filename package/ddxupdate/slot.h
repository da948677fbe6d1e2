/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The contents of the slot that does not run. The first MiB is zeros while the rest is written: the boot loader then
 * finds no kernel there, and boots the other slot. The first sector alone decides that, since it is written whole or
 * not at all. Reads and writes bypass the page cache, so that what is read back
 * comes from the disk.
 */
#ifndef DDXUPDATE_SLOT_H
#define DDXUPDATE_SLOT_H

#include <stdbool.h>
#include <stdint.h>

#include "manifest.h"
#include "pace.h"

struct slot {
    const char *device;
    int fd;
    uint64_t size;
    uint8_t *piece,
        *first;         /* memory of 1 MiB each, for O_DIRECT: any piece, and the first one, which is written last */
    struct pace *pace;  /* between writes; NULL: none */
    unsigned unflushed; /* bytes written since the last flush */
};

/* 0, or -errno after a line: -EBUSY, it is mounted. */
int slot_open(struct slot *slot, const char *device);

/* Write zeros over the first MiB, its first sector before the others, and flush. */
int slot_clear(struct slot *slot);

/* Write slot->piece, which is not the first one, unless the disk has it. Flushes every 4 MiB. */
int slot_put(struct slot *slot, const struct manifest *manifest, unsigned index);

/* After all others, write the first piece, slot->first, its first sector after the others; flush. */
int slot_finish(struct slot *slot, const struct manifest *manifest);

/* Read all pieces back; 0, -EIO after a line: a piece differs, or another error. */
int slot_compare(struct slot *slot, const struct manifest *manifest);

/* Whether these bytes are the piece. */
bool slot_fits(const struct manifest *manifest, unsigned index, const uint8_t *bytes);

void slot_close(struct slot *slot);

#endif
