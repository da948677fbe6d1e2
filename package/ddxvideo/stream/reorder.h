/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Packets of one source into their order. Nothing is held back as long as they come in order; behind a gap they wait
 * until the missing one comes, or for a bounded time, or until a bounded number of them wait.
 */
#ifndef DDXVIDEO_REORDER_H
#define DDXVIDEO_REORDER_H

#include "rtp.h"

#define REORDER_PACKETS 64 /* most that wait */
#define REORDER_JUMP 1000  /* sequence numbers further away than this are believed when two of them follow each other */
#define REORDER_MEMORY 1024 /* how far back a duplicate is told from a late packet */

struct reorder_slot {
    bool used;
    int64_t arrival;
    size_t size;
    uint8_t data[RTP_DATAGRAM_MAX];
};

/* Keep a datagram. Built with AddressSanitizer, what is behind it in the slot may not be read. */
void slot_fill(struct reorder_slot *slot, const uint8_t *data, size_t size, int64_t now);

/* Before the slots' memory is used for something else. */
void slot_clear(struct reorder_slot *slots, unsigned count);

struct reorder {
    int64_t patience; /* ns that a packet waits for one before it */
    bool begun;
    uint16_t next;        /* the sequence number that is due */
    unsigned lost_before; /* given up before it, not told yet */
    uint16_t strange;     /* the one that would follow a packet from far away */
    bool has_strange;
    unsigned waiting;
    uint8_t seen[REORDER_MEMORY / 8];          /* of the numbers before `next`: whether they came */
    struct reorder_slot slot[REORDER_PACKETS]; /* by sequence number; last, since it is large */
};

enum reorder_result {
    REORDER_TAKEN,
    REORDER_OUT_OF_TURN, /* taken; a later one came before it */
    REORDER_DUPLICATE,
    REORDER_LATE, /* its place was given up, or it comes from far away */
    REORDER_FULL  /* no room: take all out with `force`, then put it again */
};

void reorder_init(struct reorder *reorder, int64_t patience);

enum reorder_result reorder_put(struct reorder *reorder, uint16_t sequence, const uint8_t *data, size_t size,
                                int64_t now);

/*
 * The packet that is due, or NULL; it stays in place until reorder_take(). *lost: how many before it were given up.
 * `force`: do not wait any longer for what is missing.
 */
const struct reorder_slot *reorder_peek(struct reorder *reorder, int64_t now, bool force, unsigned *lost);
void reorder_take(struct reorder *reorder);

/* When reorder_peek() will give a packet although none comes; INT64_MAX if nothing waits. */
int64_t reorder_deadline(const struct reorder *reorder);

#endif
