/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Where the wire is too small for all frames and their repair, each second or third frame is sent, whole: the picture
 * moves less smoothly instead of freezing, and headers take less. The number of frames rises again when frames of a
 * fair size, and a third more, fit for three seconds. No clock.
 */
#ifndef DDXVIDEO_FRAME_RATE_H
#define DDXVIDEO_FRAME_RATE_H

#include <stdbool.h>
#include <stdint.h>

struct frame_rate {
    unsigned every; /* each frame of this number is sent: 1 to 3 */
    unsigned turn;  /* frames since the last one that was sent */
    bool begun;
    double bytes;    /* that fit, the mean of the last second */
    int64_t changed; /* time of the last change */
};

void frame_rate_init(struct frame_rate *rate, int64_t now);

/* All frames again. */
void frame_rate_reset(struct frame_rate *rate, int64_t now);

/* Before each frame. `bytes`: of a frame with its headers, if all frames are sent and can be repaired; `fair`: of a
 * frame that is worth sending; `loss`: of the best receiver. */
void frame_rate_learn(struct frame_rate *rate, int64_t now, double bytes, double fair, double loss);

/* Whether the next frame is left out. If not, and it is sent, call frame_rate_sends(). */
bool frame_rate_leaves_out(struct frame_rate *rate);
void frame_rate_sends(struct frame_rate *rate);

#endif
