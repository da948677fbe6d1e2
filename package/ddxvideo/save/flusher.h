/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The thread that flushes what another thread writes: periodically, and at the end of each file. */
#ifndef DDXVIDEO_FLUSHER_H
#define DDXVIDEO_FLUSHER_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>

#include "segment.h"

struct flusher {
    pthread_t thread;
    pthread_mutex_t lock;
    pthread_cond_t changed;
    struct segment *oldest; /* the others follow it */
    bool stop;
    int64_t period;     /* ns */
    atomic_int *error;  /* 0, or the first error, here or in the writer */
    atomic_bool unsafe; /* see struct segment */
};

/* Start; flush every `period` ns. 0 or -errno. */
int flusher_start(struct flusher *flusher, int64_t period, atomic_int *error);

/* The flusher finishes and frees the segment; its writer may go on until it closes it. */
void flusher_add(struct flusher *flusher, struct segment *segment);

/* The writer is done with the segment, and must not use it any more. */
void flusher_close_segment(struct flusher *flusher, struct segment *segment);

/* Wait until all segments are finished; they are closed. */
void flusher_stop(struct flusher *flusher);

#endif
