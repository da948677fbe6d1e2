/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A growing buffer: an encoded frame while it is put together from packets. */
#ifndef DDXVIDEO_CHUNK_H
#define DDXVIDEO_CHUNK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define CHUNK_MAX (8u << 20) /* no frame of a stream for a wireless link is larger */
#define CHUNK_PADDING 64     /* zero bytes after the last one, which libavcodec may read */

struct chunk {
    uint8_t *data;
    size_t size;
    size_t room; /* allocated, without the padding */
};

/* Append; `data` NULL appends `size` bytes that the caller fills. False if it would grow too large, or no memory. */
bool chunk_add(struct chunk *chunk, const void *data, size_t size);

/* Write zeros after the end. The chunk must have had at least one byte. */
void chunk_pad(struct chunk *chunk);

void chunk_free(struct chunk *chunk);

#endif
