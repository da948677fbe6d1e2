/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Reads the facts on one file of a recording, from its index or from the file itself. */
#ifndef DDXVIDEO_FIND_FILE_H
#define DDXVIDEO_FIND_FILE_H

#include "found.h"

/*
 * Open a file of this folder for reading, with more flags. Links are not followed, devices and pipes not waited for,
 * since root lists and copies recordings, and another user may own the folder. -errno; -EBADF: not a file.
 */
int find_open(int folder, const char *name, int flags);

/*
 * Fill in all but a changed name, from the index of found->id. False: not a recording, but free or deleted. `named`:
 * the file has a name.
 */
bool find_indexed(int pool, bool named, struct found *found);

/* Fill in all from the file found->name itself. False: not a Y4M file, and not named like a recording either. */
bool find_plain(int folder, struct found *found);

#endif
