/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "rollover.h"

#include <string.h>

#include "bits.h"

#define FIXED 12 /* bytes of the header that every packet has */
#define EXTENSION 0x10
#define ONE_BYTE 0xBEDE /* RFC 8285: elements with headers of one byte */
#define WORD 4
#define ELEMENT (ROLLOVER_ID << 4 | (WORD - 2)) /* id, and bytes after this one less one */

/* The position of the extension's header, even if it is missing; 0 if this is not an RTP packet. */
static size_t extension_of(const uint8_t *packet, size_t size) {
    if (size < FIXED || packet[0] >> 6 != 2)
        return 0;
    size_t at = FIXED + 4u * (packet[0] & 15);

    return at <= size ? at : 0;
}

/* The words of the extension at this place; 0 if it is of another form, empty, or longer than the packet. */
static size_t words_of(const uint8_t *packet, size_t size, size_t at) {
    if (size - at < WORD || get16(packet + at) != ONE_BYTE)
        return 0;
    size_t words = get16(packet + at + 2);

    return words <= (size - at) / WORD - 1 ? words : 0;
}

size_t rollover_put(uint8_t *packet, size_t size, uint32_t counter) {
    size_t at = extension_of(packet, size), words = 0, growth = WORD;

    if (!at)
        return size;
    if (packet[0] & EXTENSION) {
        words = words_of(packet, size, at);
        if (!words || words == UINT16_MAX)
            return size;
        memmove(packet + at + 2 * WORD, packet + at + WORD, size - at - WORD);
    } else {
        growth = 2 * WORD;
        memmove(packet + at + growth, packet + at, size - at);
        packet[0] |= EXTENSION;
    }
    put16(put16(packet + at, ONE_BYTE), (uint16_t)(words + 1));
    put32(packet + at + WORD, (uint32_t)ELEMENT << 24 | (counter & 0xffffff));
    return size + growth;
}

bool rollover_get(const uint8_t *packet, size_t size, uint32_t *counter) {
    size_t at = extension_of(packet, size);

    if (!at || !(packet[0] & EXTENSION) || !words_of(packet, size, at) || packet[at + WORD] != ELEMENT)
        return false;
    *counter = get32(packet + at + WORD) & 0xffffff;
    return true;
}

size_t rollover_take(uint8_t *packet, size_t size) {
    uint32_t counter;

    if (!rollover_get(packet, size, &counter))
        return size;
    size_t at = extension_of(packet, size), words = words_of(packet, size, at) - 1;
    size_t to = words ? at + WORD : at, from = at + 2 * WORD;
    memmove(packet + to, packet + from, size - from);
    if (words)
        put16(packet + at + 2, (uint16_t)words);
    else
        packet[0] &= (uint8_t)~EXTENSION;
    return size - (from - to);
}
