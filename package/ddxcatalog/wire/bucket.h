/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The limit of bytes a second for all threads together: a token bucket. Packets without new values (discovery,
 * confirmations, repeats) come first, but get half of the limit at most, since other machines cause them. Of the rest,
 * small messages have priority: they are refused only if small messages alone exceed it; large ones get what is left.
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
    int64_t rate;                /* bytes a second; 0: no limit */
    int64_t other, small, large; /* bytes that may be sent now, times 10^9; a packet or message may take it below 0 */
    int64_t time;
};

/* `rate` is at most BUCKET_MOST. */
void bucket_begin(struct bucket *bucket, uint64_t rate, int64_t now);

/* These bytes may be sent beyond the limit, once. */
void bucket_grant(struct bucket *bucket, size_t bytes);

/* Whether a message of this size may be sent now. If so, its bytes count, with the headers of its packets. */
bool bucket_take(struct bucket *bucket, size_t bytes, int64_t now);

/* A message of this size, for which bucket_take() was true, was sent in packets of `sent` bytes together. */
void bucket_correct(struct bucket *bucket, size_t bytes, size_t sent);

/* Whether a packet without new values may be sent now. If so, its bytes count. */
bool bucket_take_other(struct bucket *bucket, size_t sent, int64_t now);

#endif
