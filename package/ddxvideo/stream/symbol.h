/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Symbols: the numbers with which repair computes, over GF(256). The source symbol of a media packet (ADUI, RFC 8681,
 * section 3.2) is the number of its flow, 0 (1 byte), the length of the packet (2 bytes, big endian), and the whole RTP
 * packet. Symbols of different sizes are added as if zeros followed the shorter one.
 */
#ifndef DDXVIDEO_SYMBOL_H
#define DDXVIDEO_SYMBOL_H

#include "rtp.h"

#define SYMBOL_PREFIX 3 /* bytes before the RTP packet */
#define SYMBOL_MAX (SYMBOL_PREFIX + RTP_PACKET_MAX)

struct symbol {
    uint16_t size; /* bytes */
    uint8_t data[SYMBOL_MAX];
};

/* The source symbol of a packet of at most RTP_PACKET_MAX bytes. */
void symbol_set(struct symbol *symbol, const uint8_t *packet, size_t size);

/* Whether this is the source symbol of this packet; zeros may follow. */
bool symbol_is(const struct symbol *symbol, const uint8_t *packet, size_t size);

/* to += factor * from */
void symbol_add(struct symbol *to, const struct symbol *from, uint8_t factor);

/*
 * The packet of a source symbol, which zeros may follow; false if it is not one. Only the packet's size is checked: it
 * fits in the symbol.
 */
bool symbol_get(const struct symbol *symbol, const uint8_t **packet, size_t *size);

#endif
