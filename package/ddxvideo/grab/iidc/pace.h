/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Numbers for the frames of a camera that sends none, by their times: a step of three periods is a step of three
 * numbers. Two frames never get the same number, so a delay that looked like a loss is one loss too many, and the next
 * real one is not counted: a sum does not grow by delays alone.
 */
#ifndef DDXVIDEO_PACE_H
#define DDXVIDEO_PACE_H

#include <stdbool.h>
#include <stdint.h>

#define PACE_NONE (-1) /* as a period: the frames come when something triggers them, and none is missed */
#define PACE_ALIKE 8   /* steps that have to be alike before they are taken for the period */

struct pace {
    int64_t period;   /* ns; 0: not known yet; PACE_NONE */
    int64_t due;      /* when the frame `counted` came, without the delay that it had alone */
    uint32_t counted; /* frames that have passed by the clock */
    uint32_t number;  /* of the last frame */
    int64_t last;     /* its time; 0: there was none yet */
    uint32_t cycle;   /* of the last frame on FireWire, 0: there was none yet; when the library says that it was, */
    int64_t host;     /* and by the cycles: */
    int64_t bus;
    int64_t step;     /* what the last steps were like, since when, and how many of them: */
    int64_t since;
    unsigned alike;
};

/* Begin with the next frame. `period` 0: learn it; no loss is seen before it is known. */
void pace_restart(struct pace *pace, int64_t period);

/*
 * The number of a frame that was captured then. `more`: the next one is there already, so that this one was kept
 * waiting, and only the last one of them says how many there should have been.
 */
uint32_t pace_number(struct pace *pace, int64_t time, bool more);

/*
 * The same for FireWire, exactly: `cycle` is the frame's bus cycle, from 1 to 64000, which is 8 s. `time`, which may be
 * late by a second, says how often they have wrapped. When both disagree by more, the bus has got another cycle master,
 * and the time is taken.
 */
uint32_t pace_bus_number(struct pace *pace, uint32_t cycle, int64_t time);

#endif
