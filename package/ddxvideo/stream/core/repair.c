/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "repair.h"

#include <errno.h>
#include <string.h>

#include "bits.h"
#include "gf256.h"

/* ---- Symbols ---- */

uint16_t symbol_set(uint8_t *symbol, const uint8_t *packet, size_t size) {
    symbol[0] = 0;
    put16(symbol + 1, (uint16_t)size);
    memcpy(symbol + SYMBOL_PREFIX, packet, size);
    return (uint16_t)(SYMBOL_PREFIX + size);
}

bool symbol_is(const uint8_t *symbol, size_t bytes, const uint8_t *packet, size_t size) {
    const uint8_t *data;
    size_t length;

    return symbol_get(symbol, bytes, &data, &length) && length == size && !memcmp(data, packet, size);
}

uint16_t symbol_add(uint8_t *to, uint16_t bytes, const uint8_t *from, uint16_t from_bytes, uint8_t factor) {
    if (from_bytes > bytes)
        memset(to + bytes, 0, from_bytes - bytes);
    gf256_add(to, from, factor, from_bytes);
    return from_bytes > bytes ? from_bytes : bytes;
}

bool symbol_get(const uint8_t *symbol, size_t bytes, const uint8_t **packet, size_t *size) {
    if (bytes < SYMBOL_PREFIX || symbol[0])
        return false;
    size_t room = bytes - SYMBOL_PREFIX;
    *packet = symbol + SYMBOL_PREFIX;
    *size = get16(symbol + 1);
    return *size <= room && gf256_is_zero(*packet + *size, room - *size);
}

/* ---- Repair packets ---- */

#define FIRST_BYTE 0x81 /* version 2, no padding, no extension, one CSRC */
#define FIXED 12        /* bytes of the shortest RTP packet's header */
#define DENSITY 15

bool repair_parse(const uint8_t *data, size_t size, struct repair_packet *packet) {
    if (size < REPAIR_HEADER || size > REPAIR_MAX || data[0] != FIRST_BYTE || (data[1] & 0x7f) != REPAIR_TYPE)
        return false;
    uint16_t shape = get16(data + 18);
    *packet = (struct repair_packet){.sequence = get16(data + 2),
                                     .time = get32(data + 4),
                                     .ssrc = get32(data + 8),
                                     .media_ssrc = get32(data + 12),
                                     .key = get16(data + 16),
                                     .count = shape & 0xfff,
                                     .first = get32(data + 20),
                                     .symbol = data + REPAIR_HEADER,
                                     .size = size - REPAIR_HEADER};
    bool empty = packet->size < SYMBOL_PREFIX + FIXED;
    return shape >> 12 == DENSITY && (packet->count ? !empty && packet->count <= REPAIR_PACKETS : !packet->size);
}

void repair_window_init(struct repair_window *window, uint32_t media_ssrc, uint32_t repair_ssrc, uint16_t sequence) {
    window->media_ssrc = media_ssrc;
    window->repair_ssrc = repair_ssrc;
    window->sequence = sequence;
    window->newest = 0;
    window->next = 0;
    window->count = 0;
}

void repair_window_advance(struct repair_window *window, uint32_t esi) {
    uint16_t frame = repair_waiting(window, 0)->frame;

    if (esi != window->newest + 1)
        window->count = 0;
    if (window->count == REPAIR_PACKETS)
        window->count--;
    while (window->count && (uint16_t)(frame - repair_sent(window, window->count - 1)->frame) >= REPAIR_FRAMES)
        window->count--;
    window->next = (window->next + 1) % (REPAIR_PACKETS + REPAIR_WAITING);
    window->newest = esi;
    window->count++;
}

int repair_window_add(struct repair_window *window, uint32_t esi, uint16_t frame, const uint8_t *packet, size_t size) {
    struct repair_slot *slot = repair_waiting(window, 0);

    if (size < FIXED || size > RTP_PACKET_MAX)
        return -EMSGSIZE;
    slot->frame = frame;
    slot->symbol.size = symbol_set(slot->symbol.data, packet, size);
    repair_window_advance(window, esi);
    return 0;
}

/* The sum over the newest `count` packets; returns its size. */
static size_t put_symbol(const struct repair_window *window, unsigned count, uint8_t *to) {
    uint8_t factor[REPAIR_PACKETS];
    struct symbol sum = {.size = 0};

    repair_coefficients(window->sequence, factor, count);
    for (unsigned i = 0; i < count; i++) {
        const struct symbol *source = &repair_sent(window, count - 1 - i)->symbol;

        sum.size = symbol_add(sum.data, sum.size, source->data, source->size, factor[i]);
    }
    memcpy(to, sum.data, sum.size);
    return sum.size;
}

/* Returns the end of the header of the next packet, which covers the newest `count` packets. */
static uint8_t *put_header(struct repair_window *window, unsigned count, uint8_t *to) {
    const uint8_t *newest = repair_sent(window, 0)->symbol.data + SYMBOL_PREFIX;

    *to++ = FIRST_BYTE;
    *to++ = REPAIR_TYPE;
    to = put16(to, window->sequence);
    memcpy(to, newest + 4, 4); /* its time stamp */
    to = put32(to + 4, window->repair_ssrc);
    to = put32(to, window->media_ssrc);
    to = put16(to, window->sequence);
    to = put16(to, (uint16_t)(DENSITY << 12 | count));
    return put32(to, window->newest + 1 - count);
}

size_t repair_make(struct repair_window *window, uint32_t first, uint8_t *to) {
    int32_t before = (int32_t)(window->newest - first); /* the newest one */
    unsigned count = window->count, wanted = before < 0 ? 1 : (unsigned)before + 1;

    if (!count)
        return 0;
    if (count > wanted)
        count = wanted;
    uint8_t *at = put_header(window, count, to);
    at += put_symbol(window, count, at);
    window->sequence++;
    return (size_t)(at - to);
}

size_t repair_probe(struct repair_window *window, uint8_t *to) {
    if (!window->count)
        return 0;
    size_t size = (size_t)(put_header(window, 0, to) - to);
    window->sequence++;
    return size;
}
