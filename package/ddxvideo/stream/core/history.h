/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Send times of an RTP stream's last packets. Fixed memory, no clock. Numbers are extended sequence numbers. */
#ifndef DDXVIDEO_HISTORY_H
#define DDXVIDEO_HISTORY_H

#include <stdbool.h>
#include <stdint.h>

#define HISTORY_PACKETS 256
#define HISTORY_PROBE INT64_MIN /* `written` of a probe */

struct history {
    unsigned count;  /* remembered packets */
    uint32_t newest; /* number of the last one */
    int64_t sent[HISTORY_PACKETS];
    int64_t written[HISTORY_PACKETS]; /* time at which the packet's frame was handed over */
    uint64_t total[HISTORY_PACKETS];  /* bytes sent until then, of all streams, with this packet */
};

static inline bool history_has(const struct history *history, uint32_t number) {
    return history->newest - number < history->count;
}

static inline int64_t history_sent(const struct history *history, uint32_t number) {
    return history->sent[number % HISTORY_PACKETS];
}

static inline int64_t history_written(const struct history *history, uint32_t number) {
    return history->written[number % HISTORY_PACKETS];
}

/* Add a sent packet. If its number does not follow the last one, former packets are forgotten. */
static inline void history_add(struct history *history, uint32_t number, int64_t sent, int64_t written,
                               uint64_t total) {
    if (number != history->newest + 1)
        history->count = 0;
    history->newest = number;
    history->sent[number % HISTORY_PACKETS] = sent;
    history->written[number % HISTORY_PACKETS] = written;
    history->total[number % HISTORY_PACKETS] = total;
    history->count += history->count < HISTORY_PACKETS;
}

/* Number of packets that were sent after `from` and until `to`. */
static inline unsigned history_between(const struct history *history, int64_t from, int64_t to) {
    unsigned count = 0;

    for (uint32_t number = history->newest; history_has(history, number) && history_sent(history, number) > from;
         number--)
        count += history_sent(history, number) <= to;
    return count;
}

/* The newest packet with this sequence number, if it was ever sent. */
static inline uint32_t history_find(const struct history *history, uint16_t sequence) {
    return history->newest - (uint16_t)(history->newest - sequence);
}

/* Number of packets after `number` that were sent until this time. */
static inline unsigned history_until(const struct history *history, uint32_t number, int64_t time) {
    unsigned count = 0;

    while (history_has(history, number + count + 1) && history_sent(history, number + count + 1) <= time)
        count++;
    return count;
}

#endif
