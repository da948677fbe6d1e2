/* SPDX-License-Identifier: GPL-2.0-or-later */
/* One file of a recording: what its index says, or what it says itself. */
#ifndef DDXVIDEO_FIND_FILE_H
#define DDXVIDEO_FIND_FILE_H

#include "found.h"

/*
 * Open a file of this folder for reading, with more flags: no link, and no device or pipe that might be waited for. The
 * folder's owner is another user where root lists or copies recordings. -errno; -EBADF: it is no file.
 */
int find_open(int folder, const char *name, int flags);

/*
 * All but the name that people gave it, from the index of found->id. False: it is no recording, but free or
 * deleted (`named`: it has a name).
 */
bool find_indexed(int pool, bool named, struct found *found);

/* All from the file found->name itself. False: it is no Y4M file, and does not have the name of a recording either. */
bool find_plain(int folder, struct found *found);

#endif
