/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "offset.h"

#include <stddef.h>

#define DRIFT 10000                  /* the clocks drift apart by less than 1 ns in 10,000 */
#define LATEST (INT64_C(1) << 61)    /* limit of a clock's time, so that sums cannot overflow */
#define LONGEST INT64_C(10000000000) /* ns; longest duration of an exchange */

static bool is_time(int64_t time) {
    return time >= 0 && time < LATEST;
}

bool offset_add(struct offset *offset, int64_t sent, int64_t received, int64_t answered, int64_t now) {
    if (!is_time(sent) || !is_time(received) || !is_time(answered) || !is_time(now))
        return false;
    int64_t away = now - sent, there = answered - received, trip = away - there;
    if (there < 0 || trip < 0 || away > LONGEST)
        return false;
    offset->sample[offset->count++ % OFFSET_SAMPLES] =
        (struct offset_sample){(received - sent + answered - now) / 2, trip / 2 + there / DRIFT, now};
    return true;
}

static int64_t bound_of(const struct offset_sample *sample, int64_t now) {
    return sample->bound + (now - sample->at) / DRIFT;
}

bool offset_get(const struct offset *offset, int64_t now, int64_t *apart, int64_t *bound) {
    const struct offset_sample *best = NULL;

    for (unsigned i = 0; i < OFFSET_SAMPLES && i < offset->count; i++)
        if (!best || bound_of(&offset->sample[i], now) < bound_of(best, now))
            best = &offset->sample[i];
    if (!best)
        return false;
    *apart = best->offset;
    *bound = bound_of(best, now);
    return true;
}
