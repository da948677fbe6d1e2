/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Latency histogram with log-linear buckets: fixed memory, bounded relative error (see DDX_STATS_BUCKETS). */
#include "stats_book.h"

#define PARTS 32 /* per power of two */
#define PARTS_LOG2 5

_Static_assert(DDX_STATS_BUCKETS == PARTS + (27 - PARTS_LOG2) * PARTS, "buckets reach 2^27 us");

static unsigned bucket_of(uint64_t us) {
    if (us < PARTS)
        return (unsigned)us;
    if (us >> 27)
        return DDX_STATS_BUCKETS - 1;
    unsigned octave = 63 - (unsigned)__builtin_clzll(us); /* 5 to 26 */
    unsigned part = (unsigned)(us >> (octave - PARTS_LOG2)) - PARTS;
    return PARTS + (octave - PARTS_LOG2) * PARTS + part;
}

static uint64_t bucket_middle(unsigned bucket) {
    if (bucket < 2 * PARTS)
        return bucket; /* one µs wide */
    unsigned octave = PARTS_LOG2 + (bucket - PARTS) / PARTS;
    uint64_t width = UINT64_C(1) << (octave - PARTS_LOG2);
    return (UINT64_C(1) << octave) + (bucket - PARTS) % PARTS * width + width / 2;
}

static uint32_t saturated(uint64_t count) {
    return count > UINT32_MAX ? UINT32_MAX : (uint32_t)count;
}

void ddx_stats_histogram_add(DDX_STATS *stats, uint64_t frames, int64_t latency) {
    uint64_t us = latency > 0 ? (uint64_t)latency / 1000 : 0;
    uint32_t *bucket = &stats->latency[bucket_of(us)];

    *bucket = saturated(*bucket + frames);
    if (us > stats->latency_max)
        stats->latency_max = us;
}

void ddx_stats_histogram_merge(DDX_STATS *stats, const DDX_STATS *former) {
    for (unsigned i = 0; i < DDX_STATS_BUCKETS; i++)
        stats->latency[i] = saturated((uint64_t)stats->latency[i] + former->latency[i]);
    if (former->latency_max > stats->latency_max)
        stats->latency_max = former->latency_max;
}

uint64_t ddx_stats_percentile(const DDX_STATS *stats, double share) {
    uint64_t total = 0, below = 0;

    for (unsigned i = 0; i < DDX_STATS_BUCKETS; i++)
        total += stats->latency[i];
    double wanted = share * (double)total;
    for (unsigned i = 0; i < DDX_STATS_BUCKETS; i++) {
        below += stats->latency[i];
        if (below && (double)below >= wanted) {
            uint64_t us = i == DDX_STATS_BUCKETS - 1 ? stats->latency_max : bucket_middle(i);

            return us < stats->latency_max ? us : stats->latency_max;
        }
    }
    return 0;
}
