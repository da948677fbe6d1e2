/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_READ_H
#define DDXVIDEO_READ_H

#include "find.h"

/*
 * Write a finished file to standard output, without its first `from` bytes. It is held meanwhile (found_open()).
 * Returns the exit status, after a line if it failed.
 */
int read_file(const struct folder *folder, const struct found *found, uint64_t from);

#endif
