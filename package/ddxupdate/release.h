/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The lines about an image in its os-release. */
#ifndef DDXUPDATE_RELEASE_H
#define DDXUPDATE_RELEASE_H

#include <stdbool.h>
#include <stdint.h>

enum { RELEASE_WORD = 128 };

struct release {
    char board[RELEASE_WORD], version[RELEASE_WORD]; /* VARIANT_ID, VERSION */
    uint64_t layout, serial, oldest;                 /* DDX_LAYOUT, DDX_SERIAL, DDX_OLDEST; 0 if they are not there */
};

/* False: there is no such file, or it names no board or no version. */
bool release_read(const char *path, struct release *release);

/* Read that of the root file system on a partition, which is mounted for this moment, read-only and for this process
 * alone, at `folder`. False: no file system of ours is there, or it has no kernel. */
bool release_of_slot(const char *device, const char *folder, struct release *release);

#endif
