/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Pauses between writes to the disk, which a recorder or logger needs as well. */
#ifndef DDXUPDATE_PACE_H
#define DDXUPDATE_PACE_H

#include "sight.h"

struct pace {
    struct frames then; /* a look at the counters, at least a second before the next one */
    double then_at;     /* s; 0: none yet */
    double looked;      /* s; the last look */
    bool late;
};

/*
 * After each write that took this time (s): pause for the same time, then wait while a recorder or logger has more than
 * a second of frames that are not on the disk yet, at most a minute. A fixed rate would starve them on a slow card.
 */
void pace_rest(struct pace *pace, double took);

/* Seconds of CLOCK_MONOTONIC. */
double pace_now(void);

void pace_sleep(double seconds);

#endif
