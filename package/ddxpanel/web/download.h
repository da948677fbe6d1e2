/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A recording's file that a visitor fetches: what is asked for, and what `ddxctl recordings read -size` writes. */
#ifndef DDXPANEL_DOWNLOAD_H
#define DDXPANEL_DOWNLOAD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define DOWNLOAD_NAME 255 /* bytes of a file's name */

struct download {
    char name[DOWNLOAD_NAME + 1];
    bool is_part;         /* only these bytes of the file are wanted: */
    uint64_t first, last; /* numbers of the first and the last byte */
};

/*
 * Parse what follows "/panel/recording/", where the name may have %XX, and the headers Range and If-Range, which may be
 * NULL. One range from a byte on is understood; the whole file is the answer to another one, and to the range of
 * another file. False: it is no name.
 */
bool download_parse(struct download *wanted, const char *text, const char *range, const char *if_range);

/*
 * Parse the beginning of the output: a line with the size of the file. Returns the length of that line with its line
 * feed; 0: the output begins with something else.
 */
size_t download_hear(uint64_t *size, const char *bytes, size_t count);

/* Limit what is wanted to a file of this size. False: it has no such byte. */
bool download_limit(struct download *wanted, uint64_t size);

#endif
