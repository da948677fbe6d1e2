/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Counts which of the camera's frames are wanted, and which of those were lost, by the driver's numbers.
 *
 * Every frame of the camera has a position, from 0, the lost ones included; with -skip N those at 0, N, 2N ... are
 * wanted. So lost frames do not shift the rhythm, and only wanted frames count as lost.
 */
#ifndef DDXVIDEO_COUNT_H
#define DDXVIDEO_COUNT_H

#include <stdbool.h>
#include <stdint.h>

struct count {
    uint64_t skip;     /* at least 1 */
    uint64_t position; /* of the camera's next frame */
    uint64_t lost;     /* frames that the driver lost, unwanted ones included */
    uint32_t sequence; /* the driver's number of the last frame, if there was one since count_restart(): */
    bool running;
    int64_t since; /* capture time of an earlier frame since count_restart(), 0: none; `from`: its position */
    uint64_t from;
    bool measured; /* the period */
};

/* The driver's numbering starts again: the gap before the next frame is unknown. */
void count_restart(struct count *count);

/*
 * Count a frame with this number. Returns how many wanted frames the driver lost just before it; *wanted: whether this
 * one is wanted; *position: its position. Numbers wrap at 2^32. A number that did not rise means no loss (some drivers
 * do not count).
 */
uint64_t count_frame(struct count *count, uint32_t sequence, bool *wanted, uint64_t *position);

/* Count frames that passed without numbers. Returns how many of them were wanted. */
uint64_t count_pass(struct count *count, uint64_t frames);

/*
 * The period (ns) of a camera that reports no rate: the mean over several frames, so that delays of single frames do
 * not matter. Call it for each frame, in order; `period`: the last result, 0 at first.
 */
int64_t count_period(struct count *count, uint64_t position, int64_t time, int64_t period);

/*
 * The capture time of a frame (ns): that of the driver, unless it is more than 2 s before the camera was opened, or in
 * the future: then it is not of this machine's clock, and the result is now. After a delay of the program frames are
 * old, and their times are right.
 */
int64_t count_time(int64_t said, int64_t opened, int64_t now);

#endif
