/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A growing buffer, and numbers (little endian) and texts (length first) in it, as in MCAP. */
#ifndef DDXLOG_BYTES_H
#define DDXLOG_BYTES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct bytes {
    unsigned char *data;
    size_t size, room;
    bool failed; /* no memory: bytes are missing */
};

/* Append `size` uninitialised bytes; NULL, and `failed` is set, if there is no memory. */
void *bytes_extend(struct bytes *bytes, size_t size);

void bytes_put(struct bytes *bytes, const void *data, size_t size);
void bytes_number(struct bytes *bytes, uint64_t number, unsigned width);
void bytes_text(struct bytes *bytes, const char *text);

/* Overwrite bytes at an offset. */
void bytes_number_at(struct bytes *bytes, size_t at, uint64_t number, unsigned width);

/* Empty the buffer; its memory is used again. */
void bytes_clear(struct bytes *bytes);
void bytes_free(struct bytes *bytes);

/* The CRC32 of zlib and MCAP, continued from `crc` (0 at first). */
uint32_t crc32_of(uint32_t crc, const void *data, size_t size);

/* ---- Parsing. A read beyond the end returns 0 or NULL, and sets `failed`. ---- */

struct cursor {
    const unsigned char *at, *end;
    bool failed;
};

uint64_t cursor_number(struct cursor *cursor, unsigned width);
/* The next `size` bytes, or NULL. */
const unsigned char *cursor_bytes(struct cursor *cursor, uint64_t size);
/* A copy of a text, to free(); NULL if the text is truncated, has a zero byte in it, or there is no memory. */
char *cursor_text(struct cursor *cursor);

static inline size_t cursor_left(const struct cursor *cursor) {
    return (size_t)(cursor->end - cursor->at);
}

#endif
