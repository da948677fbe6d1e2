/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "chunk.h"

#include <stdlib.h>
#include <string.h>

#define FIRST (16u << 10)

bool chunk_add(struct chunk *chunk, const void *data, size_t size) {
    if (size > CHUNK_MAX - chunk->size)
        return false;
    if (chunk->size + size > chunk->room) {
        size_t room = chunk->room ? chunk->room : FIRST;

        while (room < chunk->size + size)
            room *= 2;
        uint8_t *larger = realloc(chunk->data, room + CHUNK_PADDING);
        if (!larger)
            return false;
        chunk->data = larger;
        chunk->room = room;
    }
    if (data && size)
        memcpy(chunk->data + chunk->size, data, size);
    chunk->size += size;
    return true;
}

void chunk_pad(struct chunk *chunk) {
    memset(chunk->data + chunk->size, 0, CHUNK_PADDING);
}

void chunk_free(struct chunk *chunk) {
    free(chunk->data);
    *chunk = (struct chunk){0};
}
