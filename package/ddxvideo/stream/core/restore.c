/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Slots have the number of their packet modulo REPAIR_PACKETS. The slot of a packet that came or was restored has its
 * source symbol. The slot of a missing packet may have an equation, a row: the packet is the row's pivot. Always true:
 *
 *   - A row's factor is 1 at its pivot, and 0 for packets before the pivot, for known packets and for pivots of others.
 *     So a row whose other factors are all 0 has become its packet, and no missing packet that could be computed from
 *     the rows is left.
 *   - Since the pivot is the oldest packet of a row, and packets are given up from the oldest on, a row that contains a
 *     packet that is given up has been dropped before, with its pivot. The other rows remain correct.
 */
#include "restore.h"

#include <errno.h>
#include <string.h>

#include "gf256.h"

#if defined(__has_feature)
#if __has_feature(address_sanitizer)
#define __SANITIZE_ADDRESS__ 1 /* like gcc */
#endif
#endif
#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/asan_interface.h>
#else
#define ASAN_POISON_MEMORY_REGION(address, size) ((void)(address), (void)(size))
#define ASAN_UNPOISON_MEMORY_REGION(address, size) ((void)(address), (void)(size))
#endif

void datagram_keep(struct kept_datagram *datagram, const uint8_t *data, size_t size, int64_t now) {
    ASAN_UNPOISON_MEMORY_REGION(datagram->data, sizeof datagram->data);
    datagram->used = true;
    datagram->arrival = now;
    datagram->size = size;
    memcpy(datagram->data, data, size);
    ASAN_POISON_MEMORY_REGION(datagram->data + size, sizeof datagram->data - size);
}

void datagram_clear(struct kept_datagram *datagrams, unsigned count) {
    for (unsigned i = 0; i < count; i++)
        ASAN_UNPOISON_MEMORY_REGION(datagrams[i].data, sizeof datagrams[i].data);
}

static unsigned slot_of(uint16_t sequence) {
    return sequence % REPAIR_PACKETS;
}

/* The oldest packet that has a slot. */
static uint16_t oldest(const struct restore *restore) {
    return (uint16_t)(restore->newest - (REPAIR_PACKETS - 1));
}

static bool is_known(const struct restore *restore, unsigned slot) {
    return restore->state[slot] >= RESTORE_CAME;
}

/* The slot has a packet, and nothing after it. */
static void seal(struct restore_slot *slot, size_t size) {
    slot->size = (uint16_t)(SYMBOL_PREFIX + size);
    ASAN_POISON_MEMORY_REGION(slot->data + slot->size, sizeof slot->data - slot->size);
}

/* The slot may get other contents. */
static void unseal(struct restore_slot *slot) {
    ASAN_UNPOISON_MEMORY_REGION(slot->data, sizeof slot->data);
}

static void set_packet(struct restore_slot *slot, const uint8_t *packet, size_t size) {
    unseal(slot);
    symbol_set(slot->data, packet, size);
    seal(slot, size);
}

/* to += factor * from, without the factors. */
static void add_symbol(struct restore_slot *to, const struct restore_slot *from, uint8_t factor) {
    to->size = symbol_add(to->data, to->size, from->data, from->size, factor);
}

static void add_row(struct restore_slot *to, const struct restore_slot *from, uint8_t factor) {
    add_symbol(to, from, factor);
    gf256_add(to->factor, from->factor, factor, REPAIR_PACKETS);
}

/* Drops the row of this slot, if there is one, and counts the reason. */
static void drop_row(struct restore *restore, unsigned slot, enum restore_count why) {
    if (restore->state[slot] != RESTORE_ROW)
        return;
    restore->state[slot] = RESTORE_MISSING;
    restore->rows--;
    restore->count[why]++;
}

/* Drops all rows: after a contradiction nothing shows which of them are correct. */
static void drop_rows(struct restore *restore, enum restore_count why) {
    for (unsigned slot = 0; slot < REPAIR_PACKETS; slot++)
        drop_row(restore, slot, why);
}

/* Whether a slot has the media packet of this number. If so, cuts off the bytes after it. */
static bool is_packet(const struct restore *restore, struct restore_slot *slot, uint16_t sequence) {
    const uint8_t *data;
    struct rtp_packet packet;
    size_t size;

    if (!symbol_get(slot->data, slot->size, &data, &size) || !rtp_parse(data, size, &packet) ||
        packet.ssrc != restore->ssrc || packet.sequence != sequence)
        return false;
    seal(slot, size);
    return true;
}

static bool is_solved(const struct restore_slot *row, unsigned pivot) {
    return gf256_is_zero(row->factor, pivot) && gf256_is_zero(row->factor + pivot + 1, REPAIR_PACKETS - 1 - pivot);
}

/* Turns solved rows into packets. */
static void settle_rows(struct restore *restore) {
    for (uint16_t sequence = restore->floor; restore->rows && sequence != (uint16_t)(restore->newest + 1); sequence++) {
        unsigned slot = slot_of(sequence);

        if (restore->state[slot] != RESTORE_ROW || !is_solved(&restore->slot[slot], slot))
            continue;
        if (!is_packet(restore, &restore->slot[slot], sequence)) {
            drop_rows(restore, RESTORE_CORRUPT);
            break;
        }
        drop_row(restore, slot, RESTORE_RESTORED);
        restore->state[slot] = RESTORE_READY;
        restore->ready++;
    }
}

/* Removes known packets and pivots of other rows from the current row. */
static void reduce_row(struct restore *restore) {
    struct restore_slot *row = &restore->row;

    for (unsigned slot = 0; slot < REPAIR_PACKETS; slot++) {
        uint8_t factor = row->factor[slot];

        if (factor && restore->state[slot] == RESTORE_ROW) {
            add_row(row, &restore->slot[slot], factor);
        } else if (factor && is_known(restore, slot)) {
            add_symbol(row, &restore->slot[slot], factor);
            row->factor[slot] = 0;
        }
    }
}

/* Adds the reduced row to the rows. False if it has nothing new. */
static bool insert_row(struct restore *restore) {
    struct restore_slot *row = &restore->row;
    uint16_t sequence = oldest(restore);

    if (gf256_is_zero(row->factor, REPAIR_PACKETS)) {
        bool fits = gf256_is_zero(row->data, row->size);

        restore->count[fits ? RESTORE_USELESS : RESTORE_CORRUPT]++;
        if (!fits)
            drop_rows(restore, RESTORE_CORRUPT);
        return false;
    }
    while (!row->factor[slot_of(sequence)])
        sequence++;
    unsigned pivot = slot_of(sequence);
    uint8_t inverse = gf256_inverse(row->factor[pivot]);
    gf256_scale(row->data, inverse, row->size);
    gf256_scale(row->factor, inverse, REPAIR_PACKETS);
    for (unsigned slot = 0; slot < REPAIR_PACKETS; slot++)
        if (restore->state[slot] == RESTORE_ROW && restore->slot[slot].factor[pivot])
            add_row(&restore->slot[slot], row, restore->slot[slot].factor[pivot]);
    unseal(&restore->slot[pivot]);
    restore->slot[pivot] = *row;
    restore->state[pivot] = RESTORE_ROW;
    restore->rows++;
    settle_rows(restore);
    return true;
}

/* Forgets all packets. */
static void forget_packets(struct restore *restore) {
    drop_rows(restore, RESTORE_EXPIRED);
    memset(restore->state, RESTORE_MISSING, sizeof restore->state);
    restore->ready = 0;
}

void restore_init(struct restore *restore, uint32_t media_ssrc) {
    memset(restore, 0, offsetof(struct restore, slot));
    restore->ssrc = media_ssrc;
    restore->newest = (uint16_t)(restore->floor - 1);
}

void restore_clear(struct restore *restore) {
    for (unsigned slot = 0; slot < REPAIR_PACKETS; slot++)
        unseal(&restore->slot[slot]);
}

/* Notes that packets up to `sequence`, which is after the newest one so far, were sent. */
static void advance_newest(struct restore *restore, uint16_t sequence) {
    if ((uint16_t)(sequence - restore->newest) >= REPAIR_PACKETS) {
        forget_packets(restore);
        restore->newest = sequence;
    }
    while (restore->newest != sequence) {
        unsigned slot = slot_of(++restore->newest);

        drop_row(restore, slot, RESTORE_EXPIRED);
        restore->ready -= restore->state[slot] == RESTORE_READY;
        restore->state[slot] = RESTORE_MISSING;
    }
    if (rtp_after(oldest(restore), restore->floor))
        restore->floor = oldest(restore);
}

static void begin_at(struct restore *restore, uint16_t sequence) {
    forget_packets(restore);
    restore->begun = true;
    restore->newest = restore->floor = restore->came = sequence;
}

/*
 * Takes back what a repair packet said about packets after the newest one that came. A sender covers no packets that it
 * has not sent, so media packets that come later have higher numbers; only a few may be overtaken. Otherwise packets
 * that were never sent would be missing after a forged repair packet.
 */
static void retract_newest(struct restore *restore) {
    drop_rows(restore, RESTORE_CORRUPT);
    while (restore->newest != restore->came) {
        unsigned slot = slot_of(restore->newest--);

        restore->ready -= restore->state[slot] == RESTORE_READY;
        restore->state[slot] = RESTORE_MISSING;
    }
    if (rtp_after(restore->floor, (uint16_t)(restore->newest + 1)))
        restore->floor = (uint16_t)(restore->newest + 1);
}

/* Makes sure that a media packet that came has a slot. */
static bool make_room(struct restore *restore, uint16_t sequence) {
    int distance = (int16_t)(sequence - restore->newest);

    if (!restore->begun) {
        begin_at(restore, sequence);
    } else if (distance > RESTORE_JUMP || distance <= -REPAIR_PACKETS) {
        if (!rtp_is_confirmed(&restore->stranger, sequence))
            return false;
        begin_at(restore, sequence);
    } else if (distance > 0) {
        advance_newest(restore, sequence);
    }
    restore->stranger.there = false;
    if (!rtp_after(sequence, restore->came))
        return true;
    restore->came = sequence;
    restore->behind = distance < 0 ? restore->behind + 1 : 0;
    if (restore->behind > RESTORE_BEHIND)
        retract_newest(restore);
    return true;
}

/* For a packet that arrives after it was restored: if they differ, the restored one was forged. */
static void compare_restored(struct restore *restore, unsigned slot, const uint8_t *packet, size_t size) {
    if (!symbol_is(restore->slot[slot].data, restore->slot[slot].size, packet, size)) {
        restore->wrong++;
        drop_rows(restore, RESTORE_CORRUPT);
        set_packet(&restore->slot[slot], packet, size);
    }
    restore->ready -= restore->state[slot] == RESTORE_READY;
    restore->state[slot] = RESTORE_CAME;
}

/* For a missing packet that came and had a row: the row is now about others. */
static void replace_row(struct restore *restore, unsigned slot, const uint8_t *packet, size_t size) {
    restore->row = restore->slot[slot];
    restore->rows--;
    restore->state[slot] = RESTORE_CAME;
    set_packet(&restore->slot[slot], packet, size);
    reduce_row(restore);
    insert_row(restore);
}

/* For a missing packet that came and had no row: takes it out of all rows. */
static void learn_packet(struct restore *restore, unsigned slot, const uint8_t *packet, size_t size) {
    restore->state[slot] = RESTORE_CAME;
    set_packet(&restore->slot[slot], packet, size);
    for (unsigned other = 0; other < REPAIR_PACKETS; other++) {
        struct restore_slot *row = &restore->slot[other];

        if (restore->state[other] != RESTORE_ROW || !row->factor[slot])
            continue;
        add_symbol(row, &restore->slot[slot], row->factor[slot]);
        row->factor[slot] = 0;
    }
    settle_rows(restore);
}

int restore_source(struct restore *restore, const uint8_t *packet, size_t size) {
    struct rtp_packet rtp;

    if (size > RTP_DATAGRAM_MAX || !rtp_parse(packet, size, &rtp) || rtp.ssrc != restore->ssrc)
        return -EBADMSG;
    if (!make_room(restore, rtp.sequence))
        return -ERANGE;
    unsigned slot = slot_of(rtp.sequence);
    switch ((enum restore_state)restore->state[slot]) {
    case RESTORE_MISSING: learn_packet(restore, slot, packet, size); return 0;
    case RESTORE_ROW: replace_row(restore, slot, packet, size); return 0;
    case RESTORE_READY:
    case RESTORE_TAKEN: compare_restored(restore, slot, packet, size); break;
    case RESTORE_CAME: break;
    }
    return -EALREADY;
}

/* The fate of a repair packet: RESTORE_RECEIVED if it is an equation for missing packets. */
static enum restore_count judge_repair(const struct restore *restore, const struct repair_packet *packet) {
    uint16_t last = (uint16_t)(packet->first + packet->count - 1);
    int ahead = (int16_t)(last - restore->came);
    uint16_t newest = rtp_after(last, restore->newest) ? last : restore->newest;
    unsigned missing = 0, given_up = 0;

    if (!packet->count)
        return RESTORE_USELESS;

    if (!restore->begun)
        return RESTORE_USELESS;
    if (ahead > RESTORE_AHEAD || ahead < -RESTORE_JUMP)
        return RESTORE_REFUSED;
    if ((uint16_t)(newest - packet->first) >= REPAIR_PACKETS)
        return RESTORE_EXPIRED;
    for (unsigned i = 0; i < packet->count; i++) {
        uint16_t sequence = (uint16_t)(packet->first + i);
        unsigned slot = slot_of(sequence);

        if (rtp_after(sequence, restore->newest) || !is_known(restore, slot))
            *(rtp_after(restore->floor, sequence) ? &given_up : &missing) += 1;
        else if (restore->slot[slot].size > packet->size)
            return RESTORE_REFUSED; /* the sum is shorter than one of its parts */
    }
    return given_up ? RESTORE_EXPIRED : missing ? RESTORE_RECEIVED : RESTORE_USELESS;
}

static void begin_row(struct restore_slot *row, const struct repair_packet *packet) {
    uint8_t factor[REPAIR_PACKETS];

    repair_coefficients(packet->key, factor, packet->count);
    memset(row->factor, 0, sizeof row->factor);
    for (unsigned i = 0; i < packet->count; i++)
        row->factor[slot_of((uint16_t)(packet->first + i))] = factor[i];
    row->size = (uint16_t)packet->size;
    memcpy(row->data, packet->symbol, packet->size);
}

int restore_repair(struct restore *restore, const uint8_t *data, size_t size) {
    struct repair_packet packet;
    enum restore_count verdict = RESTORE_REFUSED;

    restore->count[RESTORE_RECEIVED]++;
    if (repair_parse(data, size, &packet) && packet.media_ssrc == restore->ssrc)
        verdict = judge_repair(restore, &packet);
    if (verdict != RESTORE_RECEIVED) {
        restore->count[verdict]++;
        return verdict == RESTORE_REFUSED ? -EBADMSG : -EALREADY;
    }
    uint16_t last = (uint16_t)(packet.first + packet.count - 1);
    if (rtp_after(last, restore->newest)) {
        advance_newest(restore, last);
        restore->behind = 0;
    }
    begin_row(&restore->row, &packet);
    reduce_row(restore);
    return insert_row(restore) ? 0 : -EALREADY;
}

bool restore_packet(const struct restore *restore, uint16_t sequence, const uint8_t **packet, size_t *size) {
    const struct restore_slot *slot = &restore->slot[slot_of(sequence)];
    unsigned state = restore->state[slot_of(sequence)];

    *packet = slot->data + SYMBOL_PREFIX;
    *size = slot->size - SYMBOL_PREFIX;
    return (uint16_t)(restore->newest - sequence) < REPAIR_PACKETS && (state == RESTORE_CAME || state == RESTORE_TAKEN);
}

bool restore_passes(const struct restore *restore, const uint8_t *data, size_t size, uint16_t sequence) {
    struct repair_packet packet;

    return repair_parse(data, size, &packet) && packet.media_ssrc == restore->ssrc &&
           judge_repair(restore, &packet) == RESTORE_RECEIVED &&
           (int16_t)((uint16_t)(packet.first + packet.count - 1) - sequence) >= REPAIR_PACKETS;
}

bool restore_take(struct restore *restore, const uint8_t **packet, size_t *size, uint16_t *sequence) {
    if (!restore->ready)
        return false;
    *sequence = oldest(restore);
    while (restore->state[slot_of(*sequence)] != RESTORE_READY)
        ++*sequence;
    restore->state[slot_of(*sequence)] = RESTORE_TAKEN;
    restore_packet(restore, *sequence, packet, size);
    restore->ready--;
    return true;
}

bool restore_missing(const struct restore *restore, unsigned *missing, uint16_t *base, uint16_t *highest) {
    uint16_t end = (uint16_t)(restore->newest + 1);

    *missing = 0;
    *highest = restore->newest;
    *base = end;
    for (uint16_t sequence = end; sequence != restore->floor;) {
        unsigned slot = slot_of(--sequence);

        if (!is_known(restore, slot))
            *base = sequence;
        *missing += restore->state[slot] == RESTORE_MISSING;
    }
    return restore->begun;
}

void restore_give_up(struct restore *restore, uint16_t sequence) {
    uint16_t end = (uint16_t)(restore->newest + 1);

    if (!restore->begun)
        return;
    if (rtp_after(sequence, end))
        sequence = end;
    for (; rtp_after(sequence, restore->floor); restore->floor++)
        drop_row(restore, slot_of(restore->floor), RESTORE_EXPIRED);
}
