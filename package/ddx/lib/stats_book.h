/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* The counters of ddx_stats.h; private to stats*.c. */
#ifndef DDX_STATS_BOOK_H
#define DDX_STATS_BOOK_H

#include <pthread.h>
#include <stdbool.h>

#include "ddx_stats.h"

#define DDX_STATS_SUFFIX ".stats"

struct ddx_stats_book {
    pthread_mutex_t lock;
    char instance[DDX_NAME_MAX + 1];
    DDX_STATS stats;      /* totals, those of former starts included */
    unsigned restart;     /* number of the reason "restart" */
    bool failed;          /* exits without a request to stop */
    DDX_STORE_ITEM *item; /* NULL: not attached */
};

/* stats_histogram.c */
void ddx_stats_histogram_add(DDX_STATS *stats, uint64_t frames, int64_t latency);
void ddx_stats_histogram_merge(DDX_STATS *stats, const DDX_STATS *former);

#endif
