/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The program's actions on the files that were chosen. Each prints its errors, and returns the exit status. */
#ifndef DDXVIDEO_ACTIONS_H
#define DDXVIDEO_ACTIONS_H

#include "find.h"

/*
 * Copy the chosen files, which must be finished, into a folder. Each is written with a temporary name, synced, read
 * back from the medium, compared, and only then gets its own name; a file of that name is replaced. Without room for
 * all files, nothing is written. Prints progress.
 */
int export_files(const struct folder *folder, const bool *chosen, const char *to);

/*
 * Write a finished file to standard output, without its first `from` bytes. It is held meanwhile (found_open()).
 * `size`: first a line with its size, once nothing but the disk can fail; `from` may be beyond it then.
 */
int read_file(const struct folder *folder, const struct found *found, uint64_t from, bool size);

/*
 * Remove the chosen files. If one of them is being recorded, or is held by another program (found_open()), none is
 * removed. Prints a line for each file.
 */
int remove_files(const struct folder *folder, const bool *chosen);

#endif
