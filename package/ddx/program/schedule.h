/* SPDX-License-Identifier: GPL-2.0-or-later */
/* When a frame is due: exact integer arithmetic, so that the times do not drift in long runs. */
#ifndef DDX_SCHEDULE_H
#define DDX_SCHEDULE_H

#include <stdbool.h>
#include <stdint.h>

/* a * b / c rounded down, without intermediate overflow. a >= 0, b >= 0, c > 0; INT64_MAX if the result is larger. */
int64_t schedule_scale(int64_t a, uint32_t b, uint32_t c);

/* Begin of frame `index` at num/den frames per second, ns after frame 0. num > 0, den > 0. */
int64_t schedule_offset(uint64_t index, uint32_t num, uint32_t den);

/* Speed relative to the recording; num 0: without waiting. */
struct schedule_speed {
    uint32_t num, den;
};

/* "2", "0.5", "29.97" (at most six decimals, at most 1000). False if the text is not a valid speed. */
bool schedule_parse_speed(const char *text, struct schedule_speed *speed);

/* The times of a clip that is played in a loop. */
struct schedule {
    uint32_t rate_num, rate_den; /* nominal frame rate */
    int64_t period;              /* of a frame at that rate, ns */
    uint64_t index;              /* of the next frame, if no times are recorded; continues from pass to pass */
    bool recorded;               /* the clip has recorded times; the fields below are for these */
    int64_t base;                /* the first recorded time */
    int64_t pass;                /* begin of this pass through the clip */
    int64_t latest;              /* latest offset in this pass */
};

void schedule_init(struct schedule *schedule, uint32_t rate_num, uint32_t rate_den);

/*
 * Offset of the next frame from the first frame of the first pass, at normal speed. `recorded` is this frame's time in
 * the clip (at most 10^18), negative if the clip has none: then the nominal rate counts.
 */
int64_t schedule_next(struct schedule *schedule, int64_t recorded);

/* How late frames catch up. */
struct schedule_pace {
    bool begun;
    int64_t due, published; /* of the previous frame */
};

/*
 * When to publish a frame that is due at `due`. After a stall of the machine, frames follow at twice their rate until
 * they are on time again, not all at once: readers have stalled too, and the store keeps only a few frames for them.
 */
int64_t schedule_catch_up(const struct schedule_pace *pace, int64_t due);

/* Begin the clip again, one frame period after its last frame. */
void schedule_loop(struct schedule *schedule);

#endif
