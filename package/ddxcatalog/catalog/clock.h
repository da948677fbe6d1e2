/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Clocks of other machines: time stamps are exchanged once a second, more often while a clock has few measurements. */
#ifndef DDXCATALOG_CLOCK_H
#define DDXCATALOG_CLOCK_H

#include "state.h"

struct clock;

/* NULL: no memory, or a network error. */
struct clock *clock_open(struct catalog *catalog);
void clock_close(struct clock *clock);

/* Send time stamps if it is time. To be called often. */
void clock_tick(struct clock *clock);

/* Convert a time of that machine's CLOCK_MONOTONIC to this machine's, at most now; 0: the clock is not known. */
int64_t clock_local(const struct catalog *catalog, uint64_t machine, int64_t time);

#endif
