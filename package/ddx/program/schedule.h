/* SPDX-License-Identifier: GPL-2.0-or-later */
/* When a frame is due: exact integer arithmetic, so that nothing drifts however long it runs. */
#ifndef DDX_SCHEDULE_H
#define DDX_SCHEDULE_H

#include <stdbool.h>
#include <stdint.h>

/* a * b / c rounded down, without overflow in between. a >= 0, b >= 0, c > 0; INT64_MAX when the result is larger. */
int64_t schedule_scale(int64_t a, uint32_t b, uint32_t c);

/* Begin of frame `index` at num/den frames per second, ns after frame 0. num > 0, den > 0. */
int64_t schedule_offset(uint64_t index, uint32_t num, uint32_t den);

/* How much faster than recorded; num 0: without waiting. */
struct schedule_speed {
    uint32_t num, den;
};

/* "2", "0.5", "29.97" (at most six decimals, at most 1000). False if it is no such number. */
bool schedule_parse_speed(const char *text, struct schedule_speed *speed);

/* The times of a clip that is played over and over. */
struct schedule {
    uint32_t rate_num, rate_den; /* nominal frame rate */
    int64_t period;              /* of a frame at that rate, ns */
    uint64_t index;              /* of the next frame, where no times are recorded; goes on from pass to pass */
    bool recorded;               /* the clip has recorded times: */
    int64_t base;                /* the first of them */
    int64_t pass;                /* begin of this pass through the clip */
    int64_t latest;              /* latest offset in this pass */
};

void schedule_init(struct schedule *schedule, uint32_t rate_num, uint32_t rate_den);

/*
 * Offset of the next frame from the first frame of the first pass, at normal speed. `recorded` is the time that the
 * clip has for this frame (at most 10^18), negative if it has none: then the nominal rate says.
 */
int64_t schedule_next(struct schedule *schedule, int64_t recorded);

/* How frames that are late catch up. */
struct schedule_pace {
    bool begun;
    int64_t due, published; /* of the frame before */
};

/*
 * When to publish a frame that is due then. After a stall of the machine frames follow each other at twice their pace
 * until they are on time again, not all at once: readers have stalled as well, and the store keeps a few for them.
 */
int64_t schedule_catch_up(const struct schedule_pace *pace, int64_t due);

/* The clip begins again, one frame period after its last frame. */
void schedule_loop(struct schedule *schedule);

#endif
