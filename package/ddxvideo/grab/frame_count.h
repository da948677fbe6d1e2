/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Which of the camera's frames are wanted, and which of those were lost, by the driver's own numbers.
 *
 * Every frame of the camera has a position, from 0, the lost ones included; with -skip N those at 0, N, 2N ... are
 * wanted. So the rhythm stays the same when frames are lost, and only a wanted frame can be lost.
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
    int64_t since; /* when an earlier frame was captured, 0: there was none since count_restart(); and its position */
    uint64_t from;
    bool measured; /* the period */
};

/* The driver's numbering starts again: the gap before the next frame is unknown. */
void count_restart(struct count *count);

/*
 * A frame came with this number. Returns how many wanted frames the driver lost just before it; *wanted: whether this
 * one is, *position: its position. Numbers wrap at 2^32. A number that did not rise says nothing about losses (some
 * drivers do not count).
 */
uint64_t count_frame(struct count *count, uint32_t sequence, bool *wanted, uint64_t *position);

/* That number of frames passed without numbers; returns how many of them were wanted. */
uint64_t count_pass(struct count *count, uint64_t frames);

/*
 * The period (ns) of a camera that tells no rate: the mean over frames of a while, so that it does not matter when each
 * of them was taken. For each frame, in order; `period` is what it was last, 0 if it is not known yet.
 */
int64_t count_period(struct count *count, uint64_t position, int64_t time, int64_t period);

/*
 * When a frame was captured (ns): as the driver says, unless that is before the camera was opened or in the future, by
 * more than 2 s; then it is not of this machine's clock, and the time is now. A program that was held up takes frames
 * that are as old as it was held up, and their times hold.
 */
int64_t count_time(int64_t said, int64_t opened, int64_t now);

#endif
