/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "bytes.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

void *bytes_extend(struct bytes *bytes, size_t size) {
    if (size > bytes->room - bytes->size) {
        size_t room = bytes->room ? bytes->room : 256;

        while (room - bytes->size < size && room <= SIZE_MAX / 2)
            room *= 2;
        unsigned char *data = room - bytes->size < size ? NULL : realloc(bytes->data, room);
        if (!data) {
            bytes->failed = true;
            return NULL;
        }
        bytes->data = data;
        bytes->room = room;
    }
    bytes->size += size;
    return bytes->data + bytes->size - size;
}

void bytes_put(struct bytes *bytes, const void *data, size_t size) {
    void *at = size ? bytes_extend(bytes, size) : NULL;

    if (at)
        memcpy(at, data, size);
}

void bytes_number(struct bytes *bytes, uint64_t number, unsigned width) {
    if (bytes_extend(bytes, width))
        bytes_number_at(bytes, bytes->size - width, number, width);
}

void bytes_number_at(struct bytes *bytes, size_t at, uint64_t number, unsigned width) {
    for (unsigned i = 0; i < width; i++)
        bytes->data[at + i] = (unsigned char)(number >> 8 * i);
}

void bytes_text(struct bytes *bytes, const char *text) {
    size_t length = strlen(text);

    bytes_number(bytes, length, 4);
    bytes_put(bytes, text, length);
}

void bytes_clear(struct bytes *bytes) {
    bytes->size = 0;
    bytes->failed = false;
}

void bytes_free(struct bytes *bytes) {
    free(bytes->data);
    *bytes = (struct bytes){NULL, 0, 0, false};
}

/* Four bytes a step, so that the log's checksums cost little on an 800 MHz board. */
static uint32_t table[4][256];

static void fill_table(void) {
    for (uint32_t i = 0; i < 256; i++) {
        uint32_t crc = i;

        for (int bit = 0; bit < 8; bit++)
            crc = crc >> 1 ^ (crc & 1 ? UINT32_C(0xedb88320) : 0);
        table[0][i] = crc;
    }
    for (int row = 1; row < 4; row++)
        for (uint32_t i = 0; i < 256; i++)
            table[row][i] = table[row - 1][i] >> 8 ^ table[0][table[row - 1][i] & 255];
}

uint32_t crc32_of(uint32_t crc, const void *data, size_t size) {
    static pthread_once_t once = PTHREAD_ONCE_INIT;

    pthread_once(&once, fill_table);
    const unsigned char *at = data;
    crc = ~crc;
    for (; size >= 4; size -= 4, at += 4) {
        crc ^= (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
        crc = table[3][crc & 255] ^ table[2][crc >> 8 & 255] ^ table[1][crc >> 16 & 255] ^ table[0][crc >> 24];
    }
    for (; size; size--, at++)
        crc = crc >> 8 ^ table[0][(crc ^ *at) & 255];
    return ~crc;
}

const unsigned char *cursor_bytes(struct cursor *cursor, uint64_t size) {
    if (cursor->failed || size > cursor_left(cursor)) {
        cursor->failed = true;
        return NULL;
    }
    cursor->at += size;
    return cursor->at - size;
}

uint64_t cursor_number(struct cursor *cursor, unsigned width) {
    const unsigned char *at = cursor_bytes(cursor, width);
    uint64_t number = 0;

    for (unsigned i = 0; at && i < width; i++)
        number |= (uint64_t)at[i] << 8 * i;
    return number;
}

char *cursor_text(struct cursor *cursor) {
    size_t length = (size_t)cursor_number(cursor, 4);
    const unsigned char *at = cursor_bytes(cursor, length);

    if (!at || memchr(at, 0, length)) {
        cursor->failed = true;
        return NULL;
    }
    char *text = malloc(length + 1);
    if (!text) {
        cursor->failed = true;
        return NULL;
    }
    memcpy(text, at, length);
    text[length] = 0;
    return text;
}
