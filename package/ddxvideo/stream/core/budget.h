/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A token bucket for bytes. The bucket of a stream holds 0.3 s of its rate and pays for all bytes sent to one
 * receiver, IP and UDP headers included: so the mean never exceeds the rate, and no second exceeds 1.3 times the
 * rate. No clock: time is a parameter, CLOCK_MONOTONIC in ns; a time before the newest one counts as the newest one.
 */
#ifndef DDXVIDEO_BUDGET_H
#define DDXVIDEO_BUDGET_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct budget {
    int64_t rate;  /* bit/s */
    int64_t depth; /* ns of the rate that the bucket holds */
    int64_t now;   /* the newest time */
    int64_t spent; /* the rate is used up to this time; the bucket has the rest */
};

/* `rate` in bit/s, 1,000 to 1,000,000,000; `depth` in ns, at most 10 s; `share`: how full the bucket is, 0 to 1. */
void budget_init(struct budget *budget, int64_t rate, int64_t depth, double share, int64_t now);

/* Bytes that can be taken now; bytes that the full bucket holds. */
int64_t budget_tokens(struct budget *budget, int64_t now);
int64_t budget_size(const struct budget *budget);

/* Take these bytes, if the bucket holds them. */
bool budget_take(struct budget *budget, int64_t now, size_t bytes);

/* The time from which budget_take() succeeds with this number of bytes if nothing else is taken; INT64_MAX if the full
 * bucket holds less. */
int64_t budget_ready(const struct budget *budget, size_t bytes);

#endif
