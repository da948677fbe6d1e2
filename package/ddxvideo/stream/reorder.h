/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Packets of one source into their order. Nothing is held back as long as they come in order; after a gap they wait
 * until the missing packet comes, or until the caller gives it up. REORDER_PACKETS numbers from the one that is due on
 * have a place.
 */
#ifndef DDXVIDEO_REORDER_H
#define DDXVIDEO_REORDER_H

#include "rtp.h"

#define REORDER_PACKETS 256 /* numbers that have a place, as many as repair packets reach back */
#define REORDER_JUMP 1000   /* numbers further away than this are believed when two of them follow each other */
#define REORDER_MEMORY 1024 /* how far back duplicates and late packets are distinguished */

struct reorder_slot {
    bool used;
    int64_t arrival;
    size_t size;
    uint8_t data[RTP_DATAGRAM_MAX];
};

/* Keep a datagram. With AddressSanitizer the rest of the slot must not be read. */
void slot_fill(struct reorder_slot *slot, const uint8_t *data, size_t size, int64_t now);

/* Before the slots' memory is used for something else. */
void slot_clear(struct reorder_slot *slots, unsigned count);

struct reorder {
    bool begun;
    uint16_t next;        /* the sequence number that is due */
    unsigned lost_before; /* packets given up before it, not reported yet */
    struct rtp_stranger stranger;
    unsigned waiting;
    uint8_t seen[REORDER_MEMORY / 8];          /* of the numbers before `next`: whether they came */
    struct reorder_slot slot[REORDER_PACKETS]; /* by sequence number; last, since it is large */
};

enum reorder_result {
    REORDER_TAKEN,
    REORDER_OUT_OF_TURN, /* taken; a later one came before it */
    REORDER_DUPLICATE,
    REORDER_LATE, /* its place was given up, or it comes from far away */
    REORDER_FULL  /* no place: give up a missing packet, or take one out, then try again */
};

void reorder_init(struct reorder *reorder);

enum reorder_result reorder_put(struct reorder *reorder, uint16_t sequence, const uint8_t *data, size_t size,
                                int64_t now);

/* The packet that is due, or NULL; it stays in place until reorder_take(). *lost: how many before it were given up. */
const struct reorder_slot *reorder_peek(const struct reorder *reorder, unsigned *lost);
void reorder_take(struct reorder *reorder);

/* The packet that is due is missing, and given up. False if it is there, or if no other packet waits. */
bool reorder_give_up(struct reorder *reorder);

/* Arrival of the first waiting packet; INT64_MAX if none waits. */
int64_t reorder_waits_since(const struct reorder *reorder);

#endif
