/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The time at which an encoder that runs alone gets its next picture. */
#ifndef BENCH_DUE_H
#define BENCH_DUE_H

#include <stdint.h>
#include <time.h>

#include "ddx_time.h"
#include "ddxvideo.h"

/* Move `due` on by the duration of a picture, and sleep until then. */
static inline void wait_until_due(struct timespec *due, const struct ddxvideo_geometry *geometry) {
    int64_t next = due->tv_nsec + SECOND * geometry->rate_den / geometry->rate_num;

    due->tv_sec += next / SECOND;
    due->tv_nsec = next % SECOND;
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, due, NULL);
}

#endif
