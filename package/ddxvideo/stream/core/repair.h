/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Repair packets: their format, and the sender's window from which they are made. Any receiver that lost n of the
 * packets that a window covers needs n repair packets over that window, whichever these are; restore.h does that.
 *
 * A repair packet is an RTP packet (RFC 3550) with payload type REPAIR_TYPE, its own SSRC and sequence numbers, the
 * time stamp of the newest packet that it covers, and one CSRC: the SSRC of the media stream. Its payload, by RFC 8681,
 * "RLC over GF(2^8)", section 4.1.3, big endian:
 *
 *   16 bits  Repair_Key, from which the coefficients follow (gf256.h)
 *    4 bits  DT, density, always 15: no coefficient is 0
 *   12 bits  NSS, number of packets covered, 1 to REPAIR_PACKETS; 0: a probe, which has no symbol
 *   32 bits  FSS_ESI, the first of them; the others follow it without a gap
 *   bytes    repair symbol: the sum of coefficient times source symbol, as long as the longest of them
 *
 * ESI, the number of a media packet: its RTP sequence number, extended by the number of wraps since the stream began.
 * Receivers need the low 16 bits only. So media packets carry no Explicit Source FEC Payload ID, and any RTP player can
 * read them: that is the one difference from RFC 8681.
 *
 * A probe costs few bytes, and a receiver answers it with a report: so the sender learns that packets arrive again.
 *
 * No function here blocks, allocates memory or reads a clock.
 */
#ifndef DDXVIDEO_REPAIR_H
#define DDXVIDEO_REPAIR_H

#include "rtp.h"

/*
 * Symbols: the numbers with which repair computes, over GF(256). The source symbol of a media packet (ADUI, RFC 8681,
 * section 3.2) is the number of its flow, 0 (1 byte), the length of the packet (2 bytes, big endian), and the whole RTP
 * packet. Symbols of different sizes are added as if zeros followed the shorter one.
 */
#define SYMBOL_PREFIX 3 /* bytes before the RTP packet */
#define SYMBOL_MAX (SYMBOL_PREFIX + RTP_PACKET_MAX)

struct symbol {
    uint16_t size; /* bytes */
    uint8_t data[SYMBOL_MAX];
};

/* Write the source symbol of a packet. Returns its size. */
uint16_t symbol_set(uint8_t *symbol, const uint8_t *packet, size_t size);

/* Whether this is the source symbol of this packet; zeros may follow. */
bool symbol_is(const uint8_t *symbol, size_t bytes, const uint8_t *packet, size_t size);

/* to += factor * from; returns the size of the sum, for which `to` has room. */
uint16_t symbol_add(uint8_t *to, uint16_t bytes, const uint8_t *from, uint16_t from_bytes, uint8_t factor);

/*
 * The packet of a source symbol, which zeros may follow; false if it is not one. Only the packet's size is checked: it
 * fits in the symbol.
 */
bool symbol_get(const uint8_t *symbol, size_t bytes, const uint8_t **packet, size_t *size);

#define REPAIR_TYPE 98                          /* RTP payload type */
#define REPAIR_FRAMES 25                        /* most frames that a repair packet covers */
#define REPAIR_PACKETS 256                      /* most media packets that a repair packet covers */
#define REPAIR_WAITING 256                      /* most media packets that wait */
#define REPAIR_HEADER 24                        /* bytes before the repair symbol */
#define REPAIR_MAX (REPAIR_HEADER + SYMBOL_MAX) /* bytes of a repair packet */

/* A repair packet that was received. */
struct repair_packet {
    uint16_t sequence; /* of the repair stream */
    uint32_t time;
    uint32_t ssrc;       /* of the repair stream */
    uint32_t media_ssrc; /* of the stream that it repairs */
    uint16_t key;
    uint16_t count; /* media packets covered, 1 to REPAIR_PACKETS; 0: a probe */
    uint32_t first; /* ESI */
    const uint8_t *symbol;
    size_t size; /* bytes of the symbol, at most SYMBOL_MAX, enough for an RTP header; 0: a probe */
};

/* False if this is no repair packet as described above. packet->symbol points into the data. */
bool repair_parse(const uint8_t *data, size_t size, struct repair_packet *packet);

/* A media packet of the sender. */
struct repair_slot {
    uint16_t frame;
    int64_t written; /* time at which its frame was handed over; only the caller uses it */
    struct symbol symbol;
};

/*
 * The last media packets sent, at most REPAIR_PACKETS of them, of at most REPAIR_FRAMES frames. After them come up to
 * REPAIR_WAITING packets that wait to be sent, and are not covered yet.
 */
struct repair_window {
    uint32_t media_ssrc;
    uint32_t repair_ssrc;
    uint16_t sequence; /* of the next repair packet; also its Repair_Key */
    unsigned count;    /* packets in the window */
    uint32_t newest;   /* ESI of the last one */
    unsigned next;     /* slot of the first packet after it */
    struct repair_slot slot[REPAIR_PACKETS + REPAIR_WAITING];
};

/* An empty window. `sequence`: of the first repair packet, at random (RFC 3550). */
void repair_window_init(struct repair_window *window, uint32_t media_ssrc, uint32_t repair_ssrc, uint16_t sequence);

/* The slot of a packet that waits: 0: of the next one to be sent. */
static inline struct repair_slot *repair_waiting(struct repair_window *window, unsigned number) {
    return &window->slot[(window->next + number) % (REPAIR_PACKETS + REPAIR_WAITING)];
}

/* The slot of a packet in the window; 0: of the newest one. */
static inline const struct repair_slot *repair_sent(const struct repair_window *window, unsigned back) {
    return &window->slot[(window->next - 1 - back) % (REPAIR_PACKETS + REPAIR_WAITING)];
}

/*
 * The next packet that waits has been sent. `esi`: its extended sequence number; one that does not follow the last one
 * empties the window first. Frames are counted from one to the next. Packets that are too old or too many leave the
 * window.
 */
void repair_window_advance(struct repair_window *window, uint32_t esi);

/*
 * Keep a copy of an RTP packet that has been sent, where none waits. 0, or -EMSGSIZE for a packet that is shorter than
 * an RTP header or longer than RTP_PACKET_MAX: the window stays as it is.
 */
int repair_window_add(struct repair_window *window, uint32_t esi, uint16_t frame, const uint8_t *packet, size_t size);

/*
 * Make a new repair packet for the packets from `first` (an ESI) to the newest. Those that have left the window are not
 * covered; the newest one always is. Each call makes a different packet. Returns its size; 0 if the window is empty.
 * `to` has REPAIR_MAX bytes.
 */
size_t repair_make(struct repair_window *window, uint32_t first, uint8_t *to);

/* Make a probe, a repair packet that covers nothing; otherwise like repair_make(). */
size_t repair_probe(struct repair_window *window, uint8_t *to);

#endif
