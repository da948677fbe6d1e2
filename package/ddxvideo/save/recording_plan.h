/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What to record, and where to. */
#ifndef DDXVIDEO_RECORDING_PLAN_H
#define DDXVIDEO_RECORDING_PLAN_H

#include <ddx_stats.h>
#include <pthread.h>

#include "ddxvideo.h"
#include "output.h"
#include "segment_state.h"

/* Recordings of one recorder write to disk one after the other: their files get numbers in their order. */
struct recording_turn {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    unsigned begun, written; /* recordings so far */
};

/* What to record, and where to. */
struct recording_plan {
    const struct output *output;
    struct pool *pool; /* NULL: one file */
    struct ddxvideo_geometry geometry;
    unsigned queue_frames;
    struct recording_turn *turn;
    uint64_t lost_store, lost_ring; /* before its first frame */
    DDX_STATS_BOOK *book; /* counts each frame's outcome */
};

#endif
