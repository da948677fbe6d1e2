/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Numbers the frames of a camera that sends no numbers, by their times: a step of three periods is a step of three
 * numbers. Two frames never get the same number. So if a delay looked like a loss, one loss too many is counted, and
 * the next real loss is not counted: the sum does not grow by delays alone.
 */
#ifndef DDXVIDEO_PACE_H
#define DDXVIDEO_PACE_H

#include <stdbool.h>
#include <stdint.h>

/* Converts libdc1394's times (CLOCK_REALTIME) to CLOCK_MONOTONIC, without an effect of clock steps. */
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

#define PACE_NONE (-1) /* as a period: frames are triggered from outside, and no gaps are counted */
#define PACE_ALIKE 8   /* number of like steps before they are taken as the period */

struct pace {
    int64_t period;   /* ns; 0: not known yet; PACE_NONE */
    int64_t due;      /* time of the frame `counted`, without its own delay */
    uint32_t counted; /* frames by the clock */
    uint32_t number;  /* of the last frame */
    int64_t last;     /* its time; 0: no frame yet */
    uint32_t cycle;   /* of the last frame on FireWire, 0: none yet; its time by the library, */
    int64_t host;     /* and by the cycles: */
    int64_t bus;
    int64_t step; /* the last steps: their length, begin and number: */
    int64_t since;
    unsigned alike;
};

/* Begin with the next frame. `period` 0: learn it; losses are counted only when it is known. */
void pace_restart(struct pace *pace, int64_t period);

/*
 * The number of a frame that was captured at `time`. `more`: the next frame has already arrived, so this one was
 * delayed, and only the last of the waiting frames shows how many frames there should have been.
 */
uint32_t pace_number(struct pace *pace, int64_t time, bool more);

/*
 * The same for FireWire, exactly: `cycle` is the frame's bus cycle, from 1 to 64000, which is 8 s. The number of wraps
 * comes from `time`, which may be late by a second. If both disagree by more, the bus has another cycle master, and the
 * time counts.
 */
uint32_t pace_bus_number(struct pace *pace, uint32_t cycle, int64_t time);

#endif
