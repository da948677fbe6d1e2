/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Finds a file on a FAT file system (FAT12, FAT16, FAT32) that is not mounted. Writes nothing; uses no memory of its
 * own, and its time is bounded for any contents of the disk. */
#ifndef DDXUPDATE_FAT_H
#define DDXUPDATE_FAT_H

#include <stdint.h>

enum { FAT_SECTOR = 512 }; /* bytes; other sizes of a sector are refused */

struct fat_disk {
    uint64_t size; /* bytes */
    /* Read one sector into buffer[FAT_SECTOR]; 0 or -errno. */
    int (*read)(void *context, uint64_t sector, uint8_t *buffer);
    void *context;
};

struct fat_file {
    uint64_t offset; /* bytes from the begin of the file system; a multiple of FAT_SECTOR */
    uint32_t size;   /* bytes */
};

/*
 * Find a file by its path from the root, such as "grub/grubenv", by short names (8.3), in any case; the contents of the
 * file lie at file->offset in one piece. 0, or -errno: -EINVAL, no valid FAT file system; -ENOENT, no such file;
 * -EISDIR, not a file; -EFBIG, the file is in several pieces; or an error of reading.
 */
int fat_find(const struct fat_disk *disk, const char *path, struct fat_file *file);

#endif
