/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "reorder.h"

#include <string.h>

static struct reorder_slot *slot_of(struct reorder *reorder, uint16_t sequence) {
    return &reorder->slot[sequence % REORDER_PACKETS];
}

static bool is_remembered(const struct reorder *reorder, uint16_t sequence) {
    return reorder->seen[sequence % REORDER_MEMORY / 8] >> sequence % 8 & 1;
}

/* Advances to the next number; the current one came, or is given up. */
static void step_to_next(struct reorder *reorder, bool came) {
    uint8_t *byte = &reorder->seen[reorder->next % REORDER_MEMORY / 8], bit = (uint8_t)(1 << reorder->next % 8);

    *byte = came ? *byte | bit : *byte & (uint8_t)~bit;
    reorder->lost_before += !came;
    reorder->next++;
}

void reorder_init(struct reorder *reorder) {
    memset(reorder, 0, offsetof(struct reorder, slot));
    for (unsigned i = 0; i < REORDER_PACKETS; i++)
        reorder->slot[i].used = false;
}

/* The sequence numbers jumped: begin again, without counting a loss. */
static void begin_at(struct reorder *reorder, uint16_t sequence) {
    memset(reorder->seen, 0, sizeof reorder->seen);
    reorder->next = sequence;
    reorder->begun = true;
}

enum reorder_result reorder_put(struct reorder *reorder, uint16_t sequence, int64_t now) {
    if (!reorder->begun)
        begin_at(reorder, sequence);
    int distance = (int16_t)(sequence - reorder->next);
    bool far = distance < -REORDER_MEMORY || distance > REORDER_JUMP;
    if (far && !rtp_is_confirmed(&reorder->stranger, sequence))
        return REORDER_LATE;
    if ((far || distance >= REORDER_PACKETS) && reorder->waiting) {
        if (far)
            reorder->stranger.next = sequence; /* the next attempt must be accepted */
        return REORDER_FULL;
    }
    reorder->stranger.there = false;
    if (distance < -REORDER_MEMORY)
        begin_at(reorder, sequence);
    else if (distance < 0)
        return is_remembered(reorder, sequence) ? REORDER_DUPLICATE : REORDER_LATE;
    else if (distance >= REORDER_PACKETS) /* too far ahead to wait for the missing packets */
        while (reorder->next != sequence)
            step_to_next(reorder, false);

    struct reorder_slot *slot = slot_of(reorder, sequence);
    if (slot->used)
        return REORDER_DUPLICATE;
    bool overtaken = false;
    for (int i = 1; reorder->waiting && i < REORDER_PACKETS && !overtaken; i++) {
        uint16_t later = (uint16_t)(sequence + i);

        overtaken = (uint16_t)(later - reorder->next) < REORDER_PACKETS && slot_of(reorder, later)->used;
    }
    *slot = (struct reorder_slot){true, now};
    reorder->waiting++;
    return overtaken ? REORDER_OUT_OF_TURN : REORDER_TAKEN;
}

int64_t reorder_waits_since(const struct reorder *reorder) {
    int64_t first = INT64_MAX;

    for (unsigned i = 0; reorder->waiting && i < REORDER_PACKETS; i++)
        if (reorder->slot[i].used && reorder->slot[i].arrival < first)
            first = reorder->slot[i].arrival;
    return first;
}

const struct reorder_slot *reorder_peek(const struct reorder *reorder, unsigned *lost) {
    const struct reorder_slot *slot = &reorder->slot[reorder->next % REORDER_PACKETS];

    *lost = reorder->lost_before;
    return slot->used ? slot : NULL;
}

bool reorder_give_up(struct reorder *reorder) {
    if (!reorder->waiting || slot_of(reorder, reorder->next)->used)
        return false;
    step_to_next(reorder, false);
    return true;
}

void reorder_take(struct reorder *reorder) {
    slot_of(reorder, reorder->next)->used = false;
    reorder->waiting--;
    step_to_next(reorder, true);
    reorder->lost_before = 0;
}

void reorder_lose(struct reorder *reorder) {
    slot_of(reorder, reorder->next)->used = false;
    reorder->waiting--;
    step_to_next(reorder, false);
}
