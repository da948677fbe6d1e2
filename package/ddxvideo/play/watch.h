/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Asks the store about a video item, in a separate thread: a store that hangs must not stop the pictures. */
#ifndef DDXVIDEO_PLAY_WATCH_H
#define DDXVIDEO_PLAY_WATCH_H

#include <ddx_stats.h>
#include <pthread.h>
#include <stdbool.h>

enum watch_state { WATCH_NO_STORE, WATCH_NO_ITEM, WATCH_NO_VIDEO, WATCH_NO_WRITER, WATCH_WRITTEN };

struct watch_view {
    enum watch_state state;
    int64_t since; /* time of the last change, ns of CLOCK_MONOTONIC; 0: no answer yet */
    bool counted;  /* the writer of the item keeps counters */
    uint64_t lost; /* lost frames, by those counters */
};

struct watch {
    const char *name; /* of the item */
    long port;
    /* The thread's own: */
    DDX_STORE_ID *id;
    DDX_STORE_ITEM *counters; /* the writer's counters; NULL: not known */
    DDX_STATS value;
    /* Shared, under the lock: */
    pthread_mutex_t lock;
    pthread_cond_t stopped;
    bool stop;
    struct watch_view view;
    pthread_t thread;
};

/* `name` and `port` are set. 0, or -errno. */
int watch_start(struct watch *watch);

/* Waits at most 5 s for an answer of the store that is still on its way. */
void watch_stop(struct watch *watch);

/* The last answer, at most half a second old while the store answers. */
struct watch_view watch_look(struct watch *watch);

#endif
