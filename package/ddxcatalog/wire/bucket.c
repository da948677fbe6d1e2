/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "bucket.h"

#include <ddx_time.h>

#define BURST 4      /* a quarter of a second's bytes may be sent at once */
#define SHARE 2      /* half of the bytes are for packets without new values */
#define PACKET 1344  /* bytes of a message in a packet */
#define OVERHEAD 100 /* other bytes of a packet */

void bucket_begin(struct bucket *bucket, uint64_t rate, int64_t now) {
    *bucket = (struct bucket){.rate = (int64_t)rate, .time = now};
    bucket->small = bucket->large = bucket->rate * (SECOND / BURST);
    bucket->other = bucket->large / SHARE;
    pthread_mutex_init(&bucket->lock, NULL);
}

/* Up to `most`, unless more was granted. */
static void add(int64_t *bytes, int64_t more, int64_t most) {
    if (*bytes < most)
        *bytes = *bytes + more > most ? most : *bytes + more;
}

static void fill(struct bucket *bucket, int64_t now) {
    int64_t most = bucket->rate * (SECOND / BURST), passed = now - bucket->time;
    int64_t more = bucket->rate * (passed < 0 ? 0 : passed > SECOND ? SECOND : passed);

    add(&bucket->small, more, most);
    add(&bucket->large, more, most);
    add(&bucket->other, more / SHARE, most / SHARE);
    bucket->time = now;
}

void bucket_grant(struct bucket *bucket, size_t bytes) {
    int64_t more = (int64_t)bytes * SECOND;

    pthread_mutex_lock(&bucket->lock);
    bucket->small += more;
    bucket->large += more;
    bucket->other += more;
    pthread_mutex_unlock(&bucket->lock);
}

static int64_t cost_of(size_t bytes) {
    return (int64_t)(bytes + OVERHEAD * (1 + bytes / PACKET)) * SECOND;
}

bool bucket_take(struct bucket *bucket, size_t bytes, int64_t now) {
    int64_t cost = cost_of(bytes);
    bool allowed = true;

    if (!bucket->rate)
        return true;
    pthread_mutex_lock(&bucket->lock);
    fill(bucket, now);
    if (bytes <= BUCKET_SMALL) {
        allowed = bucket->small > 0;
        bucket->small -= allowed ? cost : 0;
    } else {
        allowed = bucket->large > 0;
    }
    bucket->large -= allowed ? cost : 0;
    pthread_mutex_unlock(&bucket->lock);
    return allowed;
}

void bucket_correct(struct bucket *bucket, size_t bytes, size_t sent) {
    int64_t more = (int64_t)sent * SECOND - cost_of(bytes);

    if (!bucket->rate)
        return;
    pthread_mutex_lock(&bucket->lock);
    if (bytes <= BUCKET_SMALL)
        bucket->small -= more;
    bucket->large -= more;
    pthread_mutex_unlock(&bucket->lock);
}

bool bucket_take_other(struct bucket *bucket, size_t sent, int64_t now) {
    int64_t cost = (int64_t)sent * SECOND;

    if (!bucket->rate)
        return true;
    pthread_mutex_lock(&bucket->lock);
    fill(bucket, now);
    bool allowed = bucket->other > 0;
    if (allowed) {
        bucket->other -= cost;
        bucket->small -= cost;
        bucket->large -= cost;
    }
    pthread_mutex_unlock(&bucket->lock);
    return allowed;
}
