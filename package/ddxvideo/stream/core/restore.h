/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The receiver's part of repair (repair.h): restores lost media packets from media packets and repair packets, in any
 * order. Each repair packet is an equation between the packets that it covers. The kept equations are always solved as
 * far as possible (Gauss-Jordan elimination, one equation for each call).
 *
 * Limits: fixed memory, the last REPAIR_PACKETS media packets and as many equations. A call does at most 512
 * multiplications of a symbol by a coefficient, usually one for each covered packet. No function here blocks, allocates
 * memory or reads a clock.
 *
 * One struct is for one media stream (SSRC). A source that changes its SSRC needs restore_init() again.
 */
#ifndef DDXVIDEO_RESTORE_H
#define DDXVIDEO_RESTORE_H

#include "repair.h"

/* A media packet that is further ahead than this, or before the window, is accepted when the next one follows. */
#define RESTORE_JUMP 1000
#define RESTORE_AHEAD 128 /* packets that a repair packet may reach beyond the newest media packet that came */

#define RESTORE_BEHIND 8 /* media packets in sequence that a repair packet can overtake */

/* Counts of repair packets: RECEIVED = REFUSED + USELESS + EXPIRED + CORRUPT + RESTORED + those that wait. */
enum restore_count {
    RESTORE_RECEIVED,
    RESTORE_REFUSED,  /* not a repair packet of this stream, or about impossible packets */
    RESTORE_USELESS,  /* all packets that it covers came or were restored; or no media packet has come yet */
    RESTORE_EXPIRED,  /* covers packets that were given up */
    RESTORE_CORRUPT,  /* contradicts others, or waited when a contradiction was found */
    RESTORE_RESTORED, /* each of these has restored one media packet */
    RESTORE_COUNTS
};

/* State of a media packet. */
enum restore_state {
    RESTORE_MISSING,
    RESTORE_ROW, /* missing; its slot has an equation whose oldest missing packet it is */
    RESTORE_CAME,
    RESTORE_READY, /* restored, waits for restore_take() */
    RESTORE_TAKEN
};

#define RESTORE_ROOM (SYMBOL_PREFIX + RTP_DATAGRAM_MAX)

/* A media packet that came or was restored, or an equation. With AddressSanitizer, bytes after a packet must not be
 * read. */
struct restore_slot {
    uint16_t size;                  /* bytes of: */
    uint8_t data[RESTORE_ROOM];     /* the source symbol; the sum */
    uint8_t factor[REPAIR_PACKETS]; /* only of an equation: of each packet, by sequence number */
};

/* A datagram that is kept. */
struct kept_datagram {
    bool used;
    int64_t arrival;
    size_t size;
    uint8_t data[RTP_DATAGRAM_MAX];
};

/* Keep a datagram. With AddressSanitizer, bytes after it must not be read. */
void datagram_keep(struct kept_datagram *datagram, const uint8_t *data, size_t size, int64_t now);

/* Call before the memory of datagrams is used for something else. */
void datagram_clear(struct kept_datagram *datagrams, unsigned count);

struct restore {
    uint32_t ssrc;
    bool begun; /* a media packet came */
    struct rtp_stranger stranger;
    uint16_t came;   /* newest media packet that came */
    uint16_t newest; /* newest media packet that is known to have been sent */
    unsigned behind; /* media packets that came and are before `newest`, since that changed */
    uint16_t floor;  /* packets before this one are not needed any more */
    unsigned rows;   /* equations that wait */
    unsigned ready;  /* restored packets that wait for restore_take() */
    uint64_t count[RESTORE_COUNTS];
    uint64_t wrong; /* packets that came with other contents after they were restored: forged repair packets */
    uint8_t state[REPAIR_PACKETS];            /* enum restore_state, by sequence number */
    struct restore_slot slot[REPAIR_PACKETS]; /* by sequence number */
    struct restore_slot row;                  /* the current equation */
};

void restore_init(struct restore *restore, uint32_t media_ssrc);

/* Call before its memory is used for something else. */
void restore_clear(struct restore *restore);

/*
 * Add a media packet, a whole RTP packet. The first one begins the stream: packets before it are not needed. 0;
 * -EALREADY if it came or was restored before; -ERANGE if it is too old, or a single packet from far away; -EBADMSG if
 * it is not an RTP packet of this SSRC, or longer than RTP_DATAGRAM_MAX. Packets that are REPAIR_PACKETS or more before
 * the newest one are given up.
 */
int restore_source(struct restore *restore, const uint8_t *packet, size_t size);

/*
 * Add a repair packet. 0 if it became an equation, which may have been solved at once; -EALREADY if it has nothing new
 * or useful (counted as useless, expired or corrupt); -EBADMSG if it was refused.
 */
int restore_repair(struct restore *restore, const uint8_t *packet, size_t size);

/*
 * The next restored packet, the oldest first, each one once; false if there is none. Call it after each packet that
 * came, until it returns false: a packet that leaves the window before is lost. *packet is valid until the next call of
 * another function here. It is an RTP packet of this SSRC with this sequence number, RTP_DATAGRAM_MAX bytes at most;
 * its payload is as credible as the repair packets.
 */
bool restore_take(struct restore *restore, const uint8_t **packet, size_t *size, uint16_t *sequence);

/*
 * A packet that came, or was restored and taken, and is one of the last REPAIR_PACKETS; false if it is not there. Valid
 * until the next call of another function here.
 */
bool restore_packet(const struct restore *restore, uint16_t sequence, const uint8_t **packet, size_t *size);

/* Whether restore_repair() would let packets from `sequence` on leave, with this repair packet. */
bool restore_passes(const struct restore *restore, const uint8_t *packet, size_t size, uint16_t sequence);

/*
 * The number of further repair packets that are needed to restore all missing packets from *base, the oldest missing
 * packet, to *highest, the newest packet known to have been sent. 0 with *base = *highest + 1 if none is missing. False
 * before the first media packet.
 */
bool restore_missing(const struct restore *restore, unsigned *missing, uint16_t *base, uint16_t *highest);

/*
 * Give up packets before `sequence`: equations that contain them are dropped. A number beyond the newest packet + 1
 * counts as that. A number that was passed before changes nothing.
 */
void restore_give_up(struct restore *restore, uint16_t sequence);

#endif
