/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What a file that is being recorded to has. */
#ifndef DDXVIDEO_SEGMENT_STATE_H
#define DDXVIDEO_SEGMENT_STATE_H

#include <ddx_stats.h>
#include <limits.h>
#include <stdatomic.h>
#include <sys/types.h>

#include "pool.h"

/* Reasons of loss, in the order of the names given to ddx_stats_open(). */
enum { LOST_STORE, LOST_RING, LOST_WRITE };

struct segment {
    uint64_t begin;            /* in the queue's count of bytes; the writer's */
    uint64_t written;          /* bytes; the writer's */
    uint32_t head;             /* sum of the bytes before the first frame; the writer's */
    _Atomic uint64_t whole;    /* bytes up to the end of the last whole frame */
    _Atomic uint32_t frames;   /* whole ones: what stands in `index` of these stays */
    atomic_uint adding;        /* odd while `whole` and `frames` do not belong together */
    atomic_bool closed;        /* nothing more will be written */
    char path[PATH_MAX];       /* as people know it */
    int fd;
    bool regular;     /* a file that can be cut and synced, not a pipe or device */
    atomic_bool *unsafe; /* the recording's: a flush has failed. The system reports a failed write once: no later flush
                            proves what was written since the last good one */
    uint64_t safe;    /* bytes that the disk has for certain, ... */
    uint32_t safe_frames; /* ... and the frames in them; of a file with a name of its own */
    uint64_t ordered; /* bytes that the disk has been told to write */
    /* Of the pool: */
    struct pool *pool; /* NULL: not of a pool */
    struct pool_file file;
    struct index_file *index;
    int64_t *latency; /* of each frame in it, from the store to the disk */
    DDX_STATS_BOOK *book;
    uint32_t promised;                            /* frames that are in the index on the disk */
    _Atomic uint32_t lost_store, lost_ring;       /* after the last frame */
    struct segment *next;                         /* younger */
};

#endif
