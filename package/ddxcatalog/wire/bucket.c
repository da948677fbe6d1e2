/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "bucket.h"

#define NS INT64_C(1000000000)
#define BURST 4       /* a quarter of a second's bytes may be sent at once */
#define PACKET 1344   /* bytes of a message in a packet */
#define OVERHEAD 100  /* other bytes of a packet */

void bucket_begin(struct bucket *bucket, uint64_t rate, int64_t now) {
    *bucket = (struct bucket){.rate = (int64_t)rate, .time = now};
    bucket->small = bucket->large = bucket->rate * (NS / BURST);
    pthread_mutex_init(&bucket->lock, NULL);
}

static void fill(struct bucket *bucket, int64_t now) {
    int64_t most = bucket->rate * (NS / BURST), passed = now - bucket->time;
    int64_t more = bucket->rate * (passed < 0 ? 0 : passed > NS ? NS : passed);

    bucket->small = bucket->small + more > most ? most : bucket->small + more;
    bucket->large = bucket->large + more > most ? most : bucket->large + more;
    bucket->time = now;
}

bool bucket_take(struct bucket *bucket, size_t bytes, int64_t now) {
    int64_t cost = (int64_t)(bytes + OVERHEAD * (1 + bytes / PACKET)) * NS;
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
