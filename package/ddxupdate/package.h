/* SPDX-License-Identifier: GPL-2.0-or-later */
/* An update file that is read from a stream: an archive of `manifest`, `manifest.minisig` and `root`. */
#ifndef DDXUPDATE_PACKAGE_H
#define DDXUPDATE_PACKAGE_H

#include "keys.h"
#include "manifest.h"

/*
 * Read up to the begin of `root`: check the signature over the raw manifest, then parse it. Returns the exit status: 0;
 * 2 after a line, the file is refused; 1, it cannot be read.
 */
int package_begin(int fd, const struct update_key *keys, unsigned count, struct manifest *manifest);

/* Read the next piece of `root`. 0, or 1 after a line. */
int package_piece(int fd, const struct manifest *manifest, unsigned index, uint8_t *bytes);

/* After the last piece: only the archive's end may follow. 0, or 1 after a line. */
int package_end(int fd, const struct manifest *manifest);

#endif
