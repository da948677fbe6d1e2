/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * How much the sender sends: its rate follows the link, and where even that leaves too little for all frames, it leaves
 * some out. No sockets, no clock.
 */
#ifndef DDXVIDEO_RATE_H
#define DDXVIDEO_RATE_H

#include <stdbool.h>
#include <stdint.h>

#include "budget.h"
#include "deficit.h"

/*
 * ---- The rate ----
 *
 * If packets wait in a queue before the link, the link is full, and what arrives is its rate.
 *
 * After a sudden fall of the link's rate no report can come before the first packet has passed, which is about as long
 * as one frame interval. So two frames of the former size wait before it; the third one is left out, since the packets
 * of the first one are later than any before them. Then frames are small until the link's rate is known.
 */

struct link_rate {
    int64_t wire;                  /* bit/s at most */
    double link;                   /* bit/s of the link when it was full, 0: never */
    int64_t followed;              /* time of the last change of the rate */
    int64_t held_first, held_last; /* times at which packets stayed away: the first and the last one of this case */
    bool was_full;
    int64_t full; /* the last time at which it was full */
};

/* Set the rate of the budget after a report of the receiver that has the shortest queue; NULL: none reports. */
void link_rate_follow(struct link_rate *link, struct budget *budget, const struct deficit *nearest, int64_t now);

/* Whether packets wait before the link, so that another frame would be late. `sent`: media packets. */
bool link_rate_is_full(struct link_rate *link, const struct deficit *nearest, const struct history *sent, int64_t now);

/* Whether this was so a short time ago: frames are small until the rate has followed. */
bool link_rate_was_full(const struct link_rate *link, int64_t now);

/*
 * ---- The number of frames ----
 *
 * Where the wire is too small for all frames and their repair, each second or third frame is sent, whole: the picture
 * moves less smoothly instead of freezing, and headers take less. The number of frames rises again when frames of a
 * fair size, and a third more, fit for three seconds.
 */

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
