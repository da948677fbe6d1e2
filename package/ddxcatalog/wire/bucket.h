/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * How much may be sent in a second, by all threads together: a token bucket. Small messages go first: they are refused
 * only where small ones alone are too much, and large ones get what small ones leave.
 */
#ifndef DDXCATALOG_BUCKET_H
#define DDXCATALOG_BUCKET_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define BUCKET_SMALL 8192 /* bytes of a message up to which it is small */
#define BUCKET_MOST (UINT64_C(1) << 30)

struct bucket {
    pthread_mutex_t lock;
    int64_t rate;         /* bytes a second; 0: no limit */
    int64_t small, large; /* what may be sent now, bytes times 10^9; a message may go below 0 */
    int64_t time;
};

/* `rate` is BUCKET_MOST at most. */
void bucket_begin(struct bucket *bucket, uint64_t rate, int64_t now);

/* Whether a message of that number of bytes may be sent now, which then counts. */
bool bucket_take(struct bucket *bucket, size_t bytes, int64_t now);

#endif
