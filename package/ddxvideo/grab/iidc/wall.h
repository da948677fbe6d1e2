/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Times of CLOCK_REALTIME, which libdc1394 gives, as times of CLOCK_MONOTONIC: a step of the clock does not show. */
#ifndef DDXVIDEO_WALL_H
#define DDXVIDEO_WALL_H

#include <stdint.h>

struct wall {
    int64_t offset; /* CLOCK_REALTIME - CLOCK_MONOTONIC when it was looked at last */
};

/*
 * When the frame was captured, which the library said as `us` of CLOCK_REALTIME; it is `now`, and `offset` is the
 * difference of the clocks now. The clock may have been set since then, so of the two results, by the offset of now and
 * by the last one, the one that is nearer to now is taken; no frame comes from the future. 0: the library does not say.
 */
int64_t wall_time(struct wall *wall, uint64_t us, int64_t now, int64_t offset);

#endif
