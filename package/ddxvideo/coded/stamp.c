/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The payload: UUID, version, 1 of a key frame, then big-endian numbers of 8 bytes (times, numbers) and 4 bytes.
 */
#include "stamp.h"

#include <string.h>

#include "bits.h"

#define VERSION 1
#define UUID 16
#define PLAIN (UUID + 2 + 5 * 8 + 3 * 4) /* bytes of a frame's */
#define WHOLE (PLAIN + 10 * 4)           /* of a key frame's */
#define SEI 6                            /* NAL unit type */

static const uint8_t uuid[UUID] = {0x6f, 0x2b, 0x8d, 0x1e, 0x94, 0x57, 0x4c, 0xa3,
                                   0xb0, 0x3d, 0x5e, 0x71, 0xc8, 0x26, 0xda, 0x49};

_Static_assert(WHOLE <= STAMP_MAX && WHOLE < 255, "room for it, and a size of one byte");
_Static_assert(4 + (3 + STAMP_MAX + 1) * 3 / 2 <= STAMP_NAL_MAX, "room for a 3 after each two zeros");

size_t stamp_write(uint8_t to[STAMP_MAX], const struct stamp *stamp) {
    const struct ddxvideo_geometry *g = &stamp->geometry;
    uint8_t *at = to;

    memcpy(at, uuid, UUID);
    at += UUID;
    *at++ = VERSION;
    *at++ = stamp->key;
    at = put64(at, stamp->sequence);
    at = put64(at, (uint64_t)stamp->frame);
    at = put64(at, (uint64_t)stamp->source_sequence);
    at = put64(at, (uint64_t)stamp->time);
    at = put64(at, (uint64_t)stamp->wall);
    at = put32(put32(put32(at, stamp->lost_store), stamp->lost_ring), stamp->lost_encode);
    if (!stamp->key)
        return PLAIN;
    const int numbers[10] = {g->width,      g->height,     g->fields, g->rate_num,    g->rate_den,
                             g->aspect_num, g->aspect_den, g->format, g->interlacing, g->range};
    for (int i = 0; i < 10; i++)
        at = put32(at, (uint32_t)numbers[i]);
    return WHOLE;
}

size_t stamp_write_nal(uint8_t to[STAMP_NAL_MAX], const struct stamp *stamp) {
    uint8_t plain[3 + STAMP_MAX + 1] = {SEI, STAMP_PAYLOAD};
    size_t size = stamp_write(plain + 3, stamp), used = 4;

    plain[2] = (uint8_t)size;
    size += 3;
    plain[size++] = 0x80; /* the end of a NAL unit's content */
    for (size_t i = 0, zeros = 0; i < size; i++) {
        if (zeros >= 2 && plain[i] <= 3) {
            to[used++] = 3; /* no start code may appear in it */
            zeros = 0;
        }
        zeros = plain[i] ? 0 : zeros + 1;
        to[used++] = plain[i];
    }
    put32(to, (uint32_t)(used - 4));
    return used;
}

static bool parse(const uint8_t *from, size_t size, struct stamp *stamp) {
    int numbers[10];
    const uint8_t *at = from + UUID + 2;

    if (size < PLAIN || from[UUID] != VERSION || from[UUID + 1] > 1 || size != (from[UUID + 1] ? WHOLE : PLAIN))
        return false;
    *stamp = (struct stamp){.sequence = get64(at),
                            .frame = (int64_t)get64(at + 8),
                            .source_sequence = (int64_t)get64(at + 16),
                            .time = (int64_t)get64(at + 24),
                            .wall = (int64_t)get64(at + 32),
                            .lost_store = get32(at + 40),
                            .lost_ring = get32(at + 44),
                            .lost_encode = get32(at + 48),
                            .key = from[UUID + 1]};
    if (!stamp->key)
        return true;
    for (int i = 0; i < 10; i++)
        numbers[i] = (int)get32(from + PLAIN + i * 4);
    stamp->geometry = (struct ddxvideo_geometry){.width = numbers[0],
                                                 .height = numbers[1],
                                                 .fields = numbers[2],
                                                 .rate_num = numbers[3],
                                                 .rate_den = numbers[4],
                                                 .aspect_num = numbers[5],
                                                 .aspect_den = numbers[6],
                                                 .format = numbers[7],
                                                 .interlacing = numbers[8],
                                                 .range = numbers[9]};
    return !ddxvideo_geometry_error(&stamp->geometry);
}

/* Bytes of a NAL unit without the 3 that follow two zeros; at most `room` of them. */
static size_t unescape(const uint8_t *from, size_t size, uint8_t *to, size_t room) {
    size_t used = 0;

    for (size_t i = 0, zeros = 0; i < size && used < room; i++) {
        if (zeros >= 2 && from[i] == 3) {
            zeros = 0;
            continue;
        }
        zeros = from[i] ? 0 : zeros + 1;
        to[used++] = from[i];
    }
    return used;
}

/* A number in an SEI message: bytes of 255, and one that is smaller. */
static bool take_number(const uint8_t *from, size_t size, size_t *at, size_t *value) {
    *value = 0;
    while (*at < size && from[*at] == 255 && *value < UINT16_MAX) {
        *value += 255;
        ++*at;
    }
    if (*at >= size)
        return false;
    *value += from[(*at)++];
    return true;
}

static bool parse_messages(const uint8_t *from, size_t size, struct stamp *stamp) {
    size_t at = 1, type, bytes; /* after the NAL unit's first byte */

    while (take_number(from, size, &at, &type) && take_number(from, size, &at, &bytes) && bytes <= size - at) {
        if (type == STAMP_PAYLOAD && bytes >= UUID && !memcmp(from + at, uuid, UUID))
            return parse(from + at, bytes, stamp);
        at += bytes;
    }
    return false;
}

bool stamp_read(const uint8_t *frame, size_t size, struct stamp *stamp) {
    uint8_t plain[STAMP_MAX + 64];

    while (size >= 4) {
        uint32_t bytes = get32(frame);

        frame += 4;
        size -= 4;
        if (bytes > size)
            return false;
        if (bytes && (frame[0] & 0x1f) == SEI &&
            parse_messages(plain, unescape(frame, bytes, plain, sizeof plain), stamp))
            return true;
        frame += bytes;
        size -= bytes;
    }
    return false;
}
