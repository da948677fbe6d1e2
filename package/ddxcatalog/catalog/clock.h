/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Clocks of other machines: time stamps go back and forth once a second, oftener while a clock is hardly known. */
#ifndef DDXCATALOG_CLOCK_H
#define DDXCATALOG_CLOCK_H

#include "state.h"

struct clock;

/* NULL: no memory, or the network does not take it. */
struct clock *clock_open(struct catalog *catalog);
void clock_close(struct clock *clock);

/* Send time stamps if it is time. To be called often. */
void clock_tick(struct clock *clock);

/* A time of that machine's CLOCK_MONOTONIC by this machine's, at most now; 0: its clock is not known. */
int64_t clock_local(const struct catalog *catalog, uint64_t machine, int64_t time);

#endif
