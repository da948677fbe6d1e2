/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The sender's rate follows the link: if packets wait in a queue before the link, the link is full, and what arrives is
 * its rate. No sockets, no clock.
 *
 * After a sudden fall of the link's rate no report can come before the first packet has passed, which is about as long
 * as one frame interval. So two frames of the former size wait before it; the third one is left out, since the packets
 * of the first one are later than any before them. Then frames are small until the link's rate is known.
 */
#ifndef DDXVIDEO_LINK_RATE_H
#define DDXVIDEO_LINK_RATE_H

#include "budget.h"
#include "deficit.h"

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

#endif
