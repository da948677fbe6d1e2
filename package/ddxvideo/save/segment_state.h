/* SPDX-License-Identifier: GPL-2.0-or-later */
/* State of a file of a recording. */
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
    uint32_t head;             /* checksum of the bytes before the first frame; the writer's */
    _Atomic uint64_t whole;    /* bytes up to the end of the last complete frame */
    _Atomic uint32_t frames;   /* complete ones; their entries in `index` do not change any more */
    atomic_uint adding;        /* odd while `whole` and `frames` do not match */
    atomic_bool closed;        /* nothing more will be written */
    char path[PATH_MAX];       /* as shown in messages */
    int fd;
    bool regular;     /* it can be cut and synced; not a pipe or device */
    atomic_bool *unsafe; /* the recording's: a flush has failed. The system reports a failed write once: later flushes
                            do not prove that bytes since the last good one are on the disk */
    uint64_t safe;    /* bytes that are on the disk for certain, ... */
    uint32_t safe_frames; /* ... and the frames in them; of a plain file */
    uint64_t ordered; /* bytes whose writing has been started */
    /* Of a pool file: */
    struct pool *pool; /* NULL: a plain file */
    struct pool_file file;
    struct index_file *index;
    int64_t *latency; /* of each frame, from the store to the disk */
    DDX_STATS_BOOK *book;
    uint32_t promised;                            /* frames in the index on the disk */
    _Atomic uint32_t lost_store, lost_ring;       /* frames lost after the last one */
    struct segment *next;                         /* the next newer one */
};

#endif
