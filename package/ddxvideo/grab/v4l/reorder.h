/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Frames in the order of the driver's numbers. uvcvideo lets several threads fill its buffers, so that of two frames
 * which come close together the later one may be there first. It then waits for the other one, for a while; what
 * comes too late has been counted as lost, and stays so.
 */
#ifndef DDXVIDEO_ORDER_H
#define DDXVIDEO_ORDER_H

#include <stdbool.h>
#include <stdint.h>

#define ORDER_WAITING 3 /* frames; when this many wait, the first one goes */
#define ORDER_FAR 8     /* a gap of more numbers is a loss: the driver has no more frames under way */

struct order {
    bool running;
    uint32_t last;   /* number of the last frame that went */
    uint32_t missed; /* bit i: number last - 1 - i was not there when a later one went */
    unsigned count;
    struct {
        uint32_t number;
        unsigned slot;
        int64_t since;
    } waiting[ORDER_WAITING]; /* by their numbers */
};

/* No frame waits, and the driver's numbering starts again. */
void order_restart(struct order *order);

/* A frame came, in this buffer; as long as there is one that is due it has to go first. False: too late, drop it. */
bool order_add(struct order *order, uint32_t number, unsigned slot, int64_t now);

/* The frame whose turn it is, if there is one: the next number, or one that has waited for `wait` ns. */
bool order_next(struct order *order, int64_t now, int64_t wait, unsigned *slot);

/* When the next one is due at the latest; INT64_MAX: no frame waits. */
int64_t order_due(const struct order *order, int64_t wait);

#endif
