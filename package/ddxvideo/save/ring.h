/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The ring between store and disk: the bytes of the files to be, in order, and where each frame lies. One thread puts
 * frames in and never waits; another takes bytes out, in pieces as large as the disk likes them.
 *
 * Each file begins at a multiple of RING_BLOCK in the memory: aligned pieces of the file are aligned there, too. Of a
 * block that has been taken in part all stays: a disk that is written in blocks gets it once more, with what follows.
 */
#ifndef DDXVIDEO_RING_H
#define DDXVIDEO_RING_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/uio.h>

#define RING_BLOCK 4096u
#define RING_CUTS 32 /* ends of files that may be in the ring at once */

/* What is known of a frame beside its bytes. */
struct ring_facts {
    unsigned header;   /* so many of the bytes put belong to no frame: the file's header, at its begin */
    int64_t published; /* when it was written into the store */
    int64_t time;      /* of the capture */
    int64_t wall;      /* as wall time; 0 if unknown */
    uint64_t sequence; /* in the store */
    int frame;         /* the source's number */
    unsigned lost_store, lost_ring; /* frames lost before this one */
};

struct ring_frame {
    uint64_t begin, end; /* in the ring's count of bytes */
    struct ring_facts facts;
};

struct ring {
    unsigned char *memory;
    size_t size;
    struct ring_frame *frames;
    unsigned frame_limit;
    uint64_t put, taken;               /* bytes so far */
    uint64_t frames_put, frames_taken; /* frames so far */
    uint64_t cut[RING_CUTS];           /* ends of files, in the ring's count */
    unsigned cuts_put, cuts_taken;
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

/* How full it is: 0 to 100. */
unsigned ring_level(struct ring *ring);

/* ---- The thread that puts ---- */

/* A frame, in pieces. False if there is no room; nothing was put then. */
bool ring_put(struct ring *ring, const struct iovec *pieces, int count, const struct ring_facts *facts);

/* What was put last ends its file. False if there is no room for the rest of the block, or for one more cut. */
bool ring_cut(struct ring *ring);

/* Nothing more will be put. */
void ring_close(struct ring *ring);

/* ---- The thread that takes ---- */

enum ring_next {
    RING_BYTES, /* there are some */
    RING_CUT,   /* here the file ends; ring_next_file() */
    RING_END    /* closed and empty */
};

/* The next bytes, at most `limit`; waits for them. They stay in the ring until ring_take(). */
enum ring_next ring_peek(struct ring *ring, const unsigned char **bytes, size_t *size, size_t limit);
void ring_take(struct ring *ring, size_t bytes);

/* Behind RING_CUT: the next file begins. Returns where, in the ring's count. */
uint64_t ring_next_file(struct ring *ring);

/* The oldest frame that has not been dropped yet. False if there is none. */
bool ring_oldest(struct ring *ring, struct ring_frame *frame);
void ring_drop_oldest(struct ring *ring);

#endif
