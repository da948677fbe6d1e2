/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A file of a recording: a plain file, or one of the pool, which has an index and is overwritten in place. One thread
 * writes, another flushes.
 */
#ifndef DDXVIDEO_SEGMENT_H
#define DDXVIDEO_SEGMENT_H

#include <ddx_stats.h>
#include <limits.h>
#include <stdatomic.h>
#include <sys/types.h>

#include "frame_queue.h"
#include "mp4_write.h"
#include "output.h"
#include "pool.h"

/* Reasons of loss, in the order of the names given to ddx_stats_open(). */
enum { LOST_STORE, LOST_RING, LOST_WRITE, LOST_ENCODE };

struct segment {
    uint64_t begin;          /* in the queue's count of bytes; the writer's */
    uint64_t written;        /* bytes; the writer's */
    uint32_t head;           /* checksum of the bytes before the first frame; the writer's */
    _Atomic uint64_t whole;  /* bytes up to the end of the last complete frame */
    _Atomic uint32_t frames; /* complete ones; their entries in `index` do not change any more */
    atomic_uint adding;      /* odd while `whole` and `frames` do not match */
    atomic_bool closed;      /* nothing more will be written */
    char path[PATH_MAX];     /* as shown in messages */
    int fd;
    bool regular;         /* it can be cut and synced; not a pipe or device */
    atomic_bool *unsafe;  /* the recording's: a flush has failed. The system reports a failed write once: later flushes
                            do not prove that bytes since the last good one are on the disk */
    uint64_t safe;        /* bytes that are on the disk for certain, ... */
    uint32_t safe_frames; /* ... and the frames in them; of a plain file */
    uint64_t ordered;     /* bytes whose writing has been started */
    /* Of an MP4 file: */
    const struct mp4_format *format; /* NULL: Y4M */
    bool named;                      /* it gets a table at its end; standard output does not */
    struct mp4_entry *entries;       /* of the complete frames */
    uint32_t entries_max;
    bool forgot; /* there was no memory for an entry */
    /* Of a pool file: */
    struct pool *pool; /* NULL: a plain file */
    struct pool_file file;
    bool settled; /* a file that was not prepared: its name and its allocated blocks are on the disk */
    struct index_file *index;
    int64_t *latency; /* of each frame, from the store to the disk */
    DDX_STATS_BOOK *book;
    uint32_t promised;                                   /* frames in the index on the disk */
    _Atomic uint32_t lost_store, lost_ring, lost_encode; /* frames lost after the last one */
    struct segment *next;                                /* the next newer one */
};

/*
 * Open the next file of `output`, of the pool unless that is NULL. 0 or -errno. The book counts a frame as out when it
 * is written, or in a pool when it is in the index on the disk, since only those frames survive this program.
 * `format`: of an MP4 file; it stays valid. NULL: Y4M. `session`: number of the recording's first segment; 0 if this
 * one is the first.
 */
int segment_open(const struct output *output, struct pool *pool, DDX_STATS_BOOK *book, const struct mp4_format *format,
                 uint32_t session, struct segment **segment);

/* ---- The thread that writes ---- */

/* Write the next bytes; in the queue they are aligned as in the file. Returns how many were written, or -errno. */
ssize_t segment_write(struct segment *segment, const unsigned char *bytes, size_t size);

/* A frame is complete: its place in the queue, and its checksum. */
void segment_add(struct segment *segment, const struct frame_queue_frame *frame, uint32_t sum);

/* ---- The thread that flushes ---- */

/* Bring the complete frames to the disk, and then their index entries. Waits for the disk. 0 or -errno. */
int segment_flush(struct segment *segment);

/* Whether the disk shows it as a recording: a plain file always, one of a pool from the first index entry on. */
bool segment_is_promised(const struct segment *segment);

/*
 * Bring all of it to the disk under its name; after an error, only the frames that were complete or promised before. A
 * file without a frame is not kept. Frees the segment. 0 or -errno.
 */
int segment_finish(struct segment *segment, bool failed);

#endif
