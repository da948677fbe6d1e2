/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A media stream for tests of repair: a packet's contents follow from its number; and invariants of the receiver. */
#ifndef REPAIR_STREAM_H
#define REPAIR_STREAM_H

#include <errno.h>

#include "restore.h"

#include "check.h"

#define SSRC 0x1001u
#define REPAIR_SSRC 0x2002u

static uint32_t seed = 1;

static inline unsigned next_random(unsigned below) {
    seed = seed * 1664525u + 1013904223u;
    return (seed >> 8) % below;
}

struct media {
    uint8_t data[RTP_PACKET_MAX];
    size_t size;
};

/* The packet of an ESI: 13 to 1200 bytes. */
static inline struct media media_of(uint32_t esi) {
    struct media media = {.size = 13 + esi * 2654435761u % (RTP_PACKET_MAX - 12)};
    struct rtp_packet packet = {.type = RTP_H264, .sequence = (uint16_t)esi, .time = esi * 90, .ssrc = SSRC};
    uint32_t random = esi;

    if (esi % 3) /* most are of one size */
        media.size = 200 + esi % 2;
    for (size_t i = rtp_write(media.data, &packet); i < media.size; i++) {
        random = random * 1664525u + 1013904223u;
        media.data[i] = (uint8_t)(random >> 24);
    }
    return media;
}

/* Sender and receiver, and whether each packet came or was restored, by the low 16 bits of its number. */
struct stream {
    struct repair_window window;
    struct restore restore;
    uint32_t next; /* ESI */
    bool has[65536];
    unsigned restored;
};

static inline void stream_init(struct stream *stream, uint32_t first) {
    memset(stream->has, 0, sizeof stream->has);
    repair_window_init(&stream->window, SSRC, REPAIR_SSRC, (uint16_t)(first * 7));
    restore_init(&stream->restore, SSRC);
    stream->next = first;
    stream->restored = 0;
}

/* Checks the invariants of rows and counters that restore.c states. */
static inline void check_rows(const struct restore *restore) {
    unsigned rows = 0, ready = 0, missing = 0, found;
    uint16_t base, highest;

    for (uint16_t i = 0; i < REPAIR_PACKETS; i++) {
        uint16_t pivot = (uint16_t)(restore->newest - i);
        const struct restore_slot *row = &restore->slot[pivot % REPAIR_PACKETS];
        unsigned state = restore->state[pivot % REPAIR_PACKETS];
        ready += state == RESTORE_READY;
        missing += state == RESTORE_MISSING && !rtp_after(restore->floor, pivot);
        if (state != RESTORE_ROW)
            continue;
        rows++;
        CHECK(!rtp_after(restore->floor, pivot));
        unsigned terms = 0;
        for (uint16_t j = 0; j < REPAIR_PACKETS; j++) {
            uint16_t other = (uint16_t)(restore->newest - j);
            uint8_t factor = row->factor[other % REPAIR_PACKETS];
            if (other == pivot)
                CHECK_EQUAL(factor, 1);
            else if (factor)
                CHECK(rtp_after(other, pivot) && restore->state[other % REPAIR_PACKETS] == RESTORE_MISSING);
            terms += factor != 0;
        }
        CHECK(terms > 1);
    }
    CHECK_EQUAL(rows, restore->rows);
    CHECK_EQUAL(ready, restore->ready);
    const uint64_t *count = restore->count;
    CHECK_EQUAL(count[RESTORE_RECEIVED], count[RESTORE_REFUSED] + count[RESTORE_USELESS] + count[RESTORE_EXPIRED] +
                                             count[RESTORE_CORRUPT] + count[RESTORE_RESTORED] + rows);
    if (restore_missing(restore, &found, &base, &highest)) {
        CHECK_EQUAL(found, missing);
        CHECK_EQUAL(highest, restore->newest);
        CHECK(!rtp_after(restore->floor, base) && (uint16_t)(highest - base + 1) <= REPAIR_PACKETS);
        CHECK((missing + rows == 0) == (base == (uint16_t)(highest + 1)));
    }
}

/* Takes the restored packets: in order, each once, byte for byte. */
static inline void stream_take(struct stream *stream) {
    const uint8_t *packet;
    size_t size;
    uint16_t sequence, last = 0;

    for (bool first = true; restore_take(&stream->restore, &packet, &size, &sequence); first = false) {
        uint32_t esi = stream->next - 1 - (uint16_t)((uint16_t)(stream->next - 1) - sequence);
        struct media media = media_of(esi);
        CHECK(first || rtp_after(sequence, last));
        CHECK(!stream->has[sequence]);
        CHECK_EQUAL(size, media.size);
        CHECK(!memcmp(packet, media.data, size));
        stream->has[sequence] = true;
        stream->restored++;
        last = sequence;
    }
    CHECK_EQUAL(stream->restore.ready, 0);
}

/* Delivers a packet, from memory of exactly its size. */
static inline int stream_deliver(struct stream *stream, const uint8_t *data, size_t size, bool repair) {
    uint8_t *copy = malloc(size ? size : 1);
    memcpy(copy, data, size);
    int result = repair ? restore_repair(&stream->restore, copy, size) : restore_source(&stream->restore, copy, size);
    free(copy);
    return result;
}

static inline int stream_source(struct stream *stream, uint32_t esi) {
    struct media media = media_of(esi);
    int result = stream_deliver(stream, media.data, media.size, false);
    if (!result)
        stream->has[(uint16_t)esi] = true;
    return result;
}

/* Sends the next packet, of this frame, without delivering it. */
static inline uint32_t stream_send(struct stream *stream, uint16_t frame) {
    struct media media = media_of(stream->next);
    CHECK(!repair_window_add(&stream->window, stream->next, frame, media.data, media.size));
    stream->has[(uint16_t)(stream->next + 32768)] = false;
    return stream->next++;
}

/* Begins a new stream, whose first packet is delivered. */
static inline void stream_begin(struct stream *stream, uint32_t first) {
    stream_init(stream, first);
    CHECK_EQUAL(stream_source(stream, stream_send(stream, 0)), 0);
}

/* Sends `packets` more as one frame; those with a bit in `lost` are not delivered. */
static inline void stream_lose(struct stream *stream, unsigned packets, unsigned lost) {
    for (unsigned i = 0; i < packets; i++) {
        uint32_t esi = stream_send(stream, 0);
        if (!(lost >> i & 1))
            CHECK_EQUAL(stream_source(stream, esi), 0);
    }
}

/* Delivers a new repair packet for the packets in the window from `first` on. */
static inline int stream_repair(struct stream *stream, uint32_t first) {
    uint8_t packet[REPAIR_MAX];
    size_t size = repair_make(&stream->window, first, packet);
    return stream_deliver(stream, packet, size, true);
}

#endif
