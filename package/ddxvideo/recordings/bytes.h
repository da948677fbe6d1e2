/* SPDX-License-Identifier: GPL-2.0-or-later */
/* All bytes of a file in order, past the page cache, which belongs to others: this is what the disk has. */
#ifndef DDXVIDEO_BYTES_H
#define DDXVIDEO_BYTES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/*
 * Call `take` with the first `size` bytes, piece by piece, until it returns something else than 0. `direct`: the file
 * was opened with O_DIRECT. 0; -errno; -ENODATA: the file is shorter; -EINTR: told to stop; or what `take` returned.
 */
int bytes_read(int fd, bool direct, uint64_t size, int (*take)(void *to, const unsigned char *bytes, size_t size),
               void *to);

/* INT, TERM and HUP end bytes_read() from now on. */
void bytes_catch_signals(void);

#endif
