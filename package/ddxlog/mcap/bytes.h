/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Bytes that grow, and the numbers and texts of MCAP in them: little endian, texts after their length. */
#ifndef DDXLOG_BYTES_H
#define DDXLOG_BYTES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct bytes {
    unsigned char *data;
    size_t size, room;
    bool failed; /* no memory: what was put since then is missing */
};

/*
 * Room for that number of bytes more, uninitialised; NULL if there is no memory (`failed` is set). They count at once.
 */
void *bytes_extend(struct bytes *bytes, size_t size);

void bytes_put(struct bytes *bytes, const void *data, size_t size);
void bytes_number(struct bytes *bytes, uint64_t number, unsigned width);
void bytes_text(struct bytes *bytes, const char *text);

/* Write over what is there already. */
void bytes_number_at(struct bytes *bytes, size_t at, uint64_t number, unsigned width);

/* Empty it; the memory stays for what comes. */
void bytes_clear(struct bytes *bytes);
void bytes_free(struct bytes *bytes);

/* The CRC32 of zlib and of MCAP, going on from `crc` (0 at first). */
uint32_t crc32_of(uint32_t crc, const void *data, size_t size);

/* ---- Taking them apart. What is asked for beyond the end is 0 or empty, and sets `failed`. ---- */

struct cursor {
    const unsigned char *at, *end;
    bool failed;
};

uint64_t cursor_number(struct cursor *cursor, unsigned width);
/* That number of bytes, unchanged, or NULL. */
const unsigned char *cursor_bytes(struct cursor *cursor, uint64_t size);
/* A text as a string of its own, to free(); NULL if it is cut short, has a zero byte in it, or there is no memory. */
char *cursor_text(struct cursor *cursor);

static inline size_t cursor_left(const struct cursor *cursor) {
    return (size_t)(cursor->end - cursor->at);
}

#endif
