/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Settings of a recording. */
#ifndef DDXVIDEO_RECORDING_PLAN_H
#define DDXVIDEO_RECORDING_PLAN_H

#include <ddx_stats.h>
#include <pthread.h>

#include "ddxvideo.h"
#include "output.h"
#include "segment_state.h"

/* Recordings of one recorder write to disk one after the other, so that their files are numbered in order. */
struct recording_turn {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    unsigned begun, written; /* recordings so far */
};

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
