/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Writes the state of the recorder's disk into the item `<instance>.disk`, once a second, from a separate thread:
 * recording does not wait for it.
 */
#ifndef DDXVIDEO_DISK_WATCH_H
#define DDXVIDEO_DISK_WATCH_H

#include <ddx_stats.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>

#include "encode_load.h"

/* The value of the item. The layout is the same for 32-bit and 64-bit programs. */
DDX_STORE_TYPE(
    DDX_DISK, struct {
        uint64_t free;        /* free bytes of the file system */
        uint64_t usable;      /* bytes that recordings can still take */
        uint64_t rate;        /* bytes a second that are recorded now */
        int64_t seconds_left; /* at this rate; -1: nothing is recorded, or the oldest recordings make room */
        uint32_t ready;       /* prepared files ahead */
        uint32_t recording;   /* 1; 0: paused by a command */
        uint32_t coarse;      /* frames encoded with less quality than asked for, because time or queue were short */
        uint32_t encoding;    /* % of a processor that encoding took in the last 10 s */
    });

struct disk_watch {
    const char *place;
    bool recycle;
    DDX_STATS_BOOK *book;
    struct encode_load *load;
    atomic_uint frame_bytes; /* of the current recording */
    atomic_bool paused;
    /* private: */
    DDX_STORE_ITEM *item;
    pthread_t thread;
    pthread_mutex_t lock;
    pthread_cond_t changed;
    bool stop;
};

/* Start; place, recycle and book are set. If the store has no room for the item, a line reports it. */
void disk_watch_start(struct disk_watch *watch, DDX_STORE_ID *id, const char *instance);

/* Stop, also if it was not started. Call it before ddx_store_close(), and before the book is closed. */
void disk_watch_stop(struct disk_watch *watch);

#endif
