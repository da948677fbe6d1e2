/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What the store says of a video item, asked in a thread of its own: a store that hangs must not stop the pictures. */
#ifndef DDXVIDEO_PLAY_WATCH_H
#define DDXVIDEO_PLAY_WATCH_H

#include <ddx_stats.h>
#include <pthread.h>
#include <stdbool.h>

enum watch_state { WATCH_NO_STORE, WATCH_NO_ITEM, WATCH_NO_VIDEO, WATCH_NO_WRITER, WATCH_WRITTEN };

struct watch_view {
    enum watch_state state;
    int64_t since; /* when it became so, ns of CLOCK_MONOTONIC; 0: nothing was seen yet */
    bool counted;  /* the writer of the item keeps counters */
    uint64_t lost; /* frames, by those counters */
};

struct watch {
    const char *name; /* of the item */
    long port;
    /* The thread's own: */
    DDX_STORE_ID *id;
    DDX_STORE_ITEM *counters; /* of the writer; NULL: none are known */
    DDX_STATS value;
    /* Of both, under the lock: */
    pthread_mutex_t lock;
    pthread_cond_t stopped;
    bool stop;
    struct watch_view view;
    pthread_t thread;
};

/* `name` and `port` are set. 0, or -errno. */
int watch_start(struct watch *watch);

/* Waits for an answer of the store that is on its way: at most 5 s. */
void watch_stop(struct watch *watch);

/* What was seen last: at most half a second old while the store answers. */
struct watch_view watch_look(struct watch *watch);

#endif
