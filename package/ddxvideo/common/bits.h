/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Numbers in packets and files, big endian; and single bits. */
#ifndef DDXVIDEO_BITS_H
#define DDXVIDEO_BITS_H

#include <stddef.h>
#include <stdint.h>

static inline uint8_t *put16(uint8_t *to, uint16_t value) {
    *to++ = (uint8_t)(value >> 8);
    *to++ = (uint8_t)value;
    return to;
}

static inline uint8_t *put32(uint8_t *to, uint32_t value) {
    return put16(put16(to, (uint16_t)(value >> 16)), (uint16_t)value);
}

static inline uint8_t *put64(uint8_t *to, uint64_t value) {
    return put32(put32(to, (uint32_t)(value >> 32)), (uint32_t)value);
}

static inline uint16_t get16(const uint8_t *from) {
    return (uint16_t)(from[0] << 8 | from[1]);
}

static inline uint32_t get32(const uint8_t *from) {
    return (uint32_t)get16(from) << 16 | get16(from + 2);
}

static inline uint64_t get64(const uint8_t *from) {
    return (uint64_t)get32(from) << 32 | get32(from + 4);
}

/* Reads bits, the highest first, and zeros after the end. */
struct bits {
    const uint8_t *data;
    size_t size;
    size_t at; /* bits read */
};

static inline unsigned bits_get(struct bits *bits, unsigned count) {
    unsigned value = 0;

    for (; count; count--, bits->at++) {
        size_t byte = bits->at / 8;

        value = value << 1 | (byte < bits->size ? bits->data[byte] >> (7 - bits->at % 8) & 1u : 0);
    }
    return value;
}

#endif
