/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * When players show the frames of an MP4 file: from their capture times alone, so that recorder, recovery and
 * verification get the same times.
 */
#ifndef DDXVIDEO_MP4_TIMES_H
#define DDXVIDEO_MP4_TIMES_H

#include <stdbool.h>
#include <stdint.h>

/* Zeros at the begin of a file. */
struct mp4_times {
    bool begun;
    int64_t base;   /* capture time that is shown as 0 */
    int64_t last;   /* capture time of the last frame */
    uint64_t shown; /* us at which it is shown */
};

/* ns from `from` to `to`; INT64_MAX or INT64_MIN beyond that. */
int64_t mp4_between(int64_t from, int64_t to);

/* Whether a frame captured at `time` (ns) comes more than 30 minutes after the last one: a file cannot express that. */
bool mp4_times_is_gap(const struct mp4_times *times, int64_t time);

/*
 * The next frame: us since the one before, 0 for the first one. A time that does not rise counts as 1 us later, a gap
 * above 30 minutes as 30 minutes; the following times are moved by as much.
 */
uint32_t mp4_times_next(struct mp4_times *times, int64_t time);

#endif
