/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Puts the numbers of one source's packets in order; restore.h has the packets. Packets that come in order do not wait;
 * after a gap they wait until the missing packet comes, or until the caller gives it up. There are places for
 * REORDER_PACKETS numbers, from the one that is due on.
 */
#ifndef DDXVIDEO_REORDER_H
#define DDXVIDEO_REORDER_H

#include "rtp.h"

#define REORDER_PACKETS 256 /* as many as repair packets reach back */
#define REORDER_JUMP 1000   /* numbers further away than this are accepted after two consecutive ones */
#define REORDER_MEMORY 1024 /* numbers back, within which duplicates and late packets are told apart */

struct reorder_slot {
    bool used;
    int64_t arrival;
};

struct reorder {
    bool begun;
    uint16_t next;        /* the sequence number that is due */
    unsigned lost_before; /* packets given up before that one, not reported yet */
    struct rtp_stranger stranger;
    unsigned waiting;
    uint8_t seen[REORDER_MEMORY / 8];          /* of the numbers before `next`: whether they came */
    struct reorder_slot slot[REORDER_PACKETS]; /* by sequence number */
};

enum reorder_result {
    REORDER_TAKEN,
    REORDER_OUT_OF_TURN, /* taken; a later one came before it */
    REORDER_DUPLICATE,
    REORDER_LATE, /* it was given up, or its number is far away */
    REORDER_FULL  /* no place: give up a missing packet or take one out, then try again */
};

void reorder_init(struct reorder *reorder);

enum reorder_result reorder_put(struct reorder *reorder, uint16_t sequence, int64_t now);

/* The packet that is due, or NULL; valid until reorder_take(). *lost: packets before it that were given up. */
const struct reorder_slot *reorder_peek(const struct reorder *reorder, unsigned *lost);
void reorder_take(struct reorder *reorder);

/* The packet that is due was there, but is not any more. */
void reorder_lose(struct reorder *reorder);

/* Give up the packet that is due, and missing. False if it has come, or if no other packet waits. */
bool reorder_give_up(struct reorder *reorder);

/* Arrival of the first waiting packet; INT64_MAX if none waits. */
int64_t reorder_waits_since(const struct reorder *reorder);

#endif
