/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The boot loader's block on the boot partition, which is not mounted: mounting it for writing would change other
 * sectors of the FAT at each boot. Nothing but the two sectors of grub/grubenv is ever written.
 */
#ifndef DDXUPDATE_BOOT_H
#define DDXUPDATE_BOOT_H

#include <stdint.h>

#include "block.h"

struct boot {
    const char *device; /* for messages */
    int fd, lock;
    uint64_t offset; /* of the block, in bytes */
};

/*
 * Wait until no other process reads or changes the block, open the partition (or a file with its contents) and find the
 * block. 0, or -errno after a line that says why: mounted, no FAT, no block.
 */
int boot_open(struct boot *boot, const char *device, const char *lock);

int boot_read(const struct boot *boot, char text[BLOCK_SIZE]);

/* Replace the block by one write, which is on the disk when this returns. 0, or -errno after a line. */
int boot_write(const struct boot *boot, const char text[BLOCK_SIZE]);

void boot_close(struct boot *boot);

#endif
