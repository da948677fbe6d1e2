/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * How far the clock of another machine is from this one's: from four time stamps, as in NTP. Of the newest exchanges
 * the one with the least bound counts, which is half of its round trip and what the clocks may have drifted since.
 */
#ifndef DDXCATALOG_OFFSET_H
#define DDXCATALOG_OFFSET_H

#include <stdbool.h>
#include <stdint.h>

#define OFFSET_SAMPLES 8

/* Times are ns of CLOCK_MONOTONIC of the one or of the other machine. */
struct offset_sample {
    int64_t offset, bound, at;
};

/* Zeros: nothing is known. */
struct offset {
    struct offset_sample sample[OFFSET_SAMPLES];
    unsigned count;
};

/*
 * An exchange: `sent` here, `received` there; answered there at `answered`, which came here at `now`. False: the stamps
 * cannot be.
 */
bool offset_add(struct offset *offset, int64_t sent, int64_t received, int64_t answered, int64_t now);

/* The other clock minus this one, and how far off that may be. False: nothing is known. */
bool offset_get(const struct offset *offset, int64_t now, int64_t *apart, int64_t *bound);

#endif
