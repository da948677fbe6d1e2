/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Converts libdc1394's times (CLOCK_REALTIME) to CLOCK_MONOTONIC, without an effect of clock steps. */
#ifndef DDXVIDEO_WALL_H
#define DDXVIDEO_WALL_H

#include <stdint.h>

struct wall {
    int64_t offset; /* CLOCK_REALTIME - CLOCK_MONOTONIC at the last reading */
};

/*
 * The time of capture, from `us`, the library's time by CLOCK_REALTIME. `now` is the current time, `offset` the current
 * difference of the clocks. The clock may have been set since the capture, so there are two results, by the current and
 * by the last offset; the result nearer to now is taken, and no frame comes from the future. 0: the library has no
 * time.
 */
int64_t wall_time(struct wall *wall, uint64_t us, int64_t now, int64_t offset);

#endif
