/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A lossy link on a virtual clock: which packets are lost, and when the others arrive, in order. */
#ifndef LOSSY_H
#define LOSSY_H

#include <math.h>

#include "repair.h"

#include "check.h"

#define MS INT64_C(1000000)
#define LOSSY_PACKETS 512
#define LOSSY_QUEUE (500 * MS) /* packets that would wait longer are lost */
#define LOSSY_JITTER 500000    /* ns */

static uint64_t random_state;

static inline double random_of(uint64_t *state) { /* 0 to 1 */
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    return (double)(*state >> 11) / 9007199254740992.0;
}

static inline uint64_t random_seed(uint64_t seed) {
    uint64_t state = seed * UINT64_C(0x9E3779B97F4A7C15) + 1;

    for (int i = 0; i < 10; i++)
        random_of(&state);
    return state;
}

static inline double random_share(void) {
    return random_of(&random_state);
}

static inline void random_begin(uint64_t seed) {
    random_state = random_seed(seed);
}

enum loss { EVERY_THIRD, INDEPENDENT, BURSTS, FIVES, OUTAGES, OUTAGES_TOGETHER };

/* Bursts: Gilbert's model, mean 5 packets; fives: bursts of exactly 5. Outages: exponential, mean 40 ms. Each loser has
 * a generator of its own, so that a direction's losses do not depend on the packets of the other one. */
struct loser {
    enum loss loss;
    uint64_t random; /* the generator's state, of random_seed() */
    double part;     /* of the packets, or of the time */
    unsigned count;
    bool bad;
    unsigned left;  /* of a burst of five */
    int64_t change; /* when an outage begins or is over */
};

static inline bool is_outage(struct loser *loser, int64_t now) {
    for (; loser->part > 0 && now >= loser->change; loser->bad = !loser->bad) {
        double mean = loser->bad ? 40 * (1 - loser->part) / loser->part : 40;

        loser->change += (int64_t)(-log(1 - random_of(&loser->random)) * mean * (double)MS);
    }
    return loser->bad;
}

static inline bool is_lost(struct loser *loser, int64_t now) {
    double enter = loser->part * 0.2 / (1 - loser->part);

    switch (loser->loss) {
    case EVERY_THIRD: return loser->part > 0 && ++loser->count % 3 == 0;
    case INDEPENDENT: return random_of(&loser->random) < loser->part;
    case BURSTS:
        loser->bad = loser->bad ? random_of(&loser->random) >= 0.2 : random_of(&loser->random) < enter;
        return loser->bad;
    case FIVES:
        if (!loser->left && random_of(&loser->random) < enter)
            loser->left = 5;
        return loser->left && loser->left--;
    case OUTAGES:
    case OUTAGES_TOGETHER: return is_outage(loser, now);
    }
    return false;
}

struct lossy_packet {
    int64_t arrival;
    size_t size;
    int port;
    uint8_t data[REPAIR_MAX];
};

struct lossy {
    struct loser *loser; /* may be shared */
    int64_t delay, newest;
    int64_t rate, busy; /* bit/s, 0: any; packets wait until the link is free */
    int64_t queue;      /* how long the last packet waits, ns */
    unsigned head, count;
    uint64_t sent, lost;
    struct lossy_packet packet[LOSSY_PACKETS];
};

static inline void lossy_send(struct lossy *way, int64_t now, int port, const uint8_t *data, size_t size) {
    int64_t free = way->busy > now ? way->busy : now, arrival;

    way->sent++;
    way->queue = free - now;
    if (way->rate && free - now > LOSSY_QUEUE) {
        way->lost++;
        return;
    }
    way->busy = way->rate ? free + (int64_t)(size + 28) * 8 * 1000 * MS / way->rate : now;
    arrival = way->busy + way->delay + (int64_t)(random_share() * LOSSY_JITTER);
    if (is_lost(way->loser, now)) {
        way->lost++;
        return;
    }
    CHECK(way->count < LOSSY_PACKETS && size <= REPAIR_MAX);
    struct lossy_packet *packet = &way->packet[(way->head + way->count++) % LOSSY_PACKETS];
    way->newest = packet->arrival = arrival > way->newest ? arrival : way->newest;
    packet->size = size;
    packet->port = port;
    memcpy(packet->data, data, size);
}

static inline int64_t lossy_next(const struct lossy *way) {
    return way->count ? way->packet[way->head].arrival : INT64_MAX;
}

static inline const struct lossy_packet *lossy_take(struct lossy *way, int64_t now) {
    if (lossy_next(way) > now)
        return NULL;
    const struct lossy_packet *packet = &way->packet[way->head];
    way->head = (way->head + 1) % LOSSY_PACKETS;
    way->count--;
    return packet;
}

#endif
