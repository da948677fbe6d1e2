/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_EXPORT_H
#define DDXVIDEO_EXPORT_H

#include "find.h"

/*
 * Copy the chosen files, which must be finished, into a folder. Each is written with a temporary name, synced, read
 * back from the medium, compared, and only then gets its own name; a file of that name is replaced. Without room for
 * all files, nothing is written. Prints progress and errors. Returns the exit status.
 */
int export_files(const struct folder *folder, const bool *chosen, const char *to);

#endif
