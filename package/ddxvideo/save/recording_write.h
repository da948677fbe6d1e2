/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The inside of a recording, shared by the reading and the writing thread. */
#ifndef DDXVIDEO_RECORDING_WRITE_H
#define DDXVIDEO_RECORDING_WRITE_H

#include "flusher.h"
#include "frame_queue.h"
#include "recording_plan.h"
#include "segment.h"

struct recording {
    struct recording_plan plan;
    struct frame_queue queue;
    struct flusher flusher;
    pthread_t thread;
    unsigned turn;    /* number of recordings that write before this one */
    atomic_int error; /* 0 or -errno */
    atomic_bool done; /* the writing thread is done */
    /* of the reading thread: */
    int64_t start;                  /* time of the first frame of the current file */
    uint64_t file_bytes;            /* of the current file; 0: the next frame begins it */
    uint32_t file_frames;
    bool split;                     /* the next frame begins another recording */
    _Atomic uint32_t begins;        /* bit N: after the queue's cut N (modulo their number) another recording begins */
    uint64_t lost_store, lost_ring; /* since the last frame that was put */
    _Atomic uint32_t lost_store_last, lost_ring_last; /* after the last one */
    /* of the writing thread: */
    uint32_t session;        /* number of the first segment */
    struct segment *segment; /* NULL: before the first one, or after an error */
    uint64_t position;       /* of the next byte, in the queue's count */
    char path[PATH_MAX];     /* of the current file, or the last one; "" before the first */
    uint32_t sum;            /* checksum of the bytes so far of the frame, or of the file's first line */
};

/* The writing thread; the argument is the recording, whose queue begins with a cut. */
void *recording_write(void *argument);

#endif
