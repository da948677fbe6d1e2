/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The difference between another machine's clock and this machine's, from four time stamps, as in NTP. Of the newest
 * exchanges the one with the least bound counts: half of the round trip, plus the possible drift of the clocks since.
 */
#ifndef DDXCATALOG_OFFSET_H
#define DDXCATALOG_OFFSET_H

#include <stdbool.h>
#include <stdint.h>

#define OFFSET_SAMPLES 8

/* Times are ns of CLOCK_MONOTONIC of either machine. */
struct offset_sample {
    int64_t offset, bound, at;
};

/* All 0: no exchange yet. */
struct offset {
    struct offset_sample sample[OFFSET_SAMPLES];
    unsigned count;
};

/*
 * Add an exchange: `sent` here, `received` there; `answered` there, and the answer arrived here at `now`. False: these
 * stamps are impossible.
 */
bool offset_add(struct offset *offset, int64_t sent, int64_t received, int64_t answered, int64_t now);

/* The other clock minus this clock, and the bound of the error. False: not known. */
bool offset_get(const struct offset *offset, int64_t now, int64_t *apart, int64_t *bound);

#endif
