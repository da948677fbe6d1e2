/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Frames in the order of the driver's numbers. uvcvideo lets several threads fill its buffers, so that of two frames
 * which come close together the later one may be there first. It then waits for the earlier one for a limited time. A
 * frame that comes too late remains counted as lost.
 */
#ifndef DDXVIDEO_ORDER_H
#define DDXVIDEO_ORDER_H

#include <stdbool.h>
#include <stdint.h>

#define ORDER_WAITING 3 /* frames; with this many the first one is passed on */
#define ORDER_FAR 8     /* a larger gap in the numbers is a loss: the driver has fewer frames under way */

struct order {
    bool running;
    uint32_t last;   /* number of the last frame that was passed on */
    uint32_t missed; /* bit i: number last - 1 - i had not come when a later one was passed on */
    unsigned count;
    struct {
        uint32_t number;
        unsigned slot;
        int64_t since;
    } waiting[ORDER_WAITING]; /* in the order of their numbers */
};

/* Drop waiting frames; the driver's numbering starts again. */
void order_restart(struct order *order);

/* Add a frame in this buffer; first take all frames that are due. False: too late, drop it. */
bool order_add(struct order *order, uint32_t number, unsigned slot, int64_t now);

/* Take the frame that is due, if there is one: the next number, or one that has waited for `wait` ns. */
bool order_next(struct order *order, int64_t now, int64_t wait, unsigned *slot);

/* The latest time at which the next frame is due; INT64_MAX: no frame waits. */
int64_t order_due(const struct order *order, int64_t wait);

#endif
