/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Reads a file in order past the page cache: the bytes on the disk, and memory stays free for other programs. */
#ifndef DDXVIDEO_BYTES_H
#define DDXVIDEO_BYTES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/*
 * Call `take` with the first `size` bytes, piece by piece, until it returns a value other than 0. `direct`: the file
 * was opened with O_DIRECT. 0; -errno; -ENODATA: the file is shorter; -EINTR: a stop was requested; or the value of
 * `take`.
 */
int bytes_read(int fd, bool direct, uint64_t size, int (*take)(void *to, const unsigned char *bytes, size_t size),
               void *to);

/* The same without the first `from` bytes of these. */
int bytes_read_from(int fd, bool direct, uint64_t from, uint64_t size,
                    int (*take)(void *to, const unsigned char *bytes, size_t size), void *to);

/* Write all of these bytes. 0 or -errno. */
int bytes_write(int fd, const unsigned char *bytes, size_t size);

/* From now on bytes_read() and bytes_read_from() print a line, "12 %", for each percent of `total` bytes read. */
void bytes_show_progress(uint64_t total);

/* From now on INT, TERM and HUP stop bytes_read(). */
void bytes_catch_signals(void);

#endif
