/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The ring between store and disk: the bytes of the file to be, in order, and where each frame ends. One thread puts
 * frames in and never waits; another takes bytes out, in pieces as large as the disk likes them.
 *
 * Byte n of the file is byte n % size of the memory, so that aligned pieces of the file are aligned in memory.
 */
#ifndef DDXVIDEO_RING_H
#define DDXVIDEO_RING_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/uio.h>

struct ring_frame {
    uint64_t end;  /* in the file */
    int64_t stamp; /* whatever the caller wants to know again when the frame is out */
};

struct ring {
    unsigned char *memory;
    size_t size;
    struct ring_frame *frames;
    unsigned frame_limit;
    uint64_t put, taken;               /* bytes so far */
    uint64_t frames_put, frames_taken; /* frames so far */
    bool closed;
    pthread_mutex_t lock;
    pthread_cond_t changed;
    pthread_t populator;
    bool populating;
    atomic_bool enough;
};

/* Room for `frames` frames of at most `frame_bytes`; the memory is taken in the background. 0 or -errno. */
int ring_init(struct ring *ring, unsigned frames, size_t frame_bytes);
void ring_free(struct ring *ring);

/* Bytes that belong to no frame: a file header. As ring_put(). */
bool ring_put_bytes(struct ring *ring, const void *bytes, size_t size);

/* A frame, in pieces. False if there is no room; nothing was put then. */
bool ring_put(struct ring *ring, const struct iovec *pieces, int count, int64_t stamp);

/* Nothing more will be put. */
void ring_close(struct ring *ring);

/*
 * The next bytes, at most `limit`; waits for the first. Returns 0 when the ring is closed and empty. They stay in
 * the ring until ring_take().
 */
size_t ring_peek(struct ring *ring, const unsigned char **bytes, size_t limit);
void ring_take(struct ring *ring, size_t bytes);

/* The next frame all of whose bytes have been taken. False if there is none. */
bool ring_next_frame(struct ring *ring, struct ring_frame *frame);

#endif
