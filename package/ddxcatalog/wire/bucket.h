/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The limit of bytes a second for all threads together: a token bucket. Small messages have priority: they are refused
 * only if small messages alone exceed the limit, and large messages get the rest.
 */
#ifndef DDXCATALOG_BUCKET_H
#define DDXCATALOG_BUCKET_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define BUCKET_SMALL 8192 /* bytes; a message of up to this size is small */
#define BUCKET_MOST (UINT64_C(1) << 30)

struct bucket {
    pthread_mutex_t lock;
    int64_t rate;         /* bytes a second; 0: no limit */
    int64_t small, large; /* bytes that may be sent now, times 10^9; a message may take it below 0 */
    int64_t time;
};

/* `rate` is at most BUCKET_MOST. */
void bucket_begin(struct bucket *bucket, uint64_t rate, int64_t now);

/* Whether a message of this size may be sent now. If so, its bytes count. */
bool bucket_take(struct bucket *bucket, size_t bytes, int64_t now);

#endif
