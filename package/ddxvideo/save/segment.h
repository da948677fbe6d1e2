/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * One file that is being recorded to: one with a name of its own, or one of the pool, which has an index and is
 * overwritten in place. One thread writes, another makes safe what has been written.
 */
#ifndef DDXVIDEO_SEGMENT_H
#define DDXVIDEO_SEGMENT_H

#include <ddx_stats.h>
#include <limits.h>
#include <stdatomic.h>
#include <sys/types.h>

#include "output.h"
#include "pool.h"
#include "frame_queue.h"

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
    _Atomic uint32_t lost_store, lost_ring;       /* behind the last frame */
    struct segment *next;                         /* younger */
};

/*
 * Open the next file of `output`, in its pool unless that is NULL. 0 or -errno. Each frame that is out is counted in
 * the book: written, or in a pool promised by the index, since only that survives this program. `session`: number of
 * the segment that began what this one continues; 0 if it begins something itself.
 */
int segment_open(const struct output *output, struct pool *pool, DDX_STATS_BOOK *book, uint32_t session,
                 struct segment **segment);

/* ---- The thread that writes ---- */

/* Write the next bytes; they lie in the queue, where they are aligned like the file. Returns how many, or -errno. */
ssize_t segment_write(struct segment *segment, const unsigned char *bytes, size_t size);

/* A frame is whole: its place in the queue, and its sum. */
void segment_add(struct segment *segment, const struct frame_queue_frame *frame, uint32_t sum);

/* ---- The thread that makes safe ---- */

/* What is whole now is on the disk, and then promised by the index. Waits for the disk. 0 or -errno. */
int segment_flush(struct segment *segment);

/* Whether the disk knows of it: always, if it has a name of its own; in a pool with the first frame promised. */
bool segment_is_promised(const struct segment *segment);

/*
 * Nothing more comes: all of it is on the disk, under its name; or, after an error, what was whole or promised until
 * then. A file without a frame is not kept. Frees the segment. 0 or -errno.
 */
int segment_finish(struct segment *segment, bool failed);

#endif
