/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The queue between store and disk: the bytes of the files, in order, and the place of each frame. One thread puts
 * frames in and never waits; another takes bytes out, in pieces of the size that suits the disk. For users of the
 * recorder it is the ring (-ring, lost.ring).
 *
 * Each file begins at a multiple of FRAME_QUEUE_BLOCK in the memory, so that aligned pieces of the file are aligned
 * there. A block that has been taken in part stays whole: a disk that is written in blocks gets it again, with the
 * bytes that follow.
 */
#ifndef DDXVIDEO_FRAME_QUEUE_H
#define DDXVIDEO_FRAME_QUEUE_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/uio.h>

#define FRAME_QUEUE_BLOCK 4096u
#define FRAME_QUEUE_CUTS 32 /* maximum number of ends of files in the queue */

/* Facts on a frame, beside its bytes. */
struct frame_queue_facts {
    unsigned header;                /* bytes before the frame: the file's header, before its first frame */
    int64_t published;              /* time of its write into the store */
    int64_t time;                   /* of the capture */
    int64_t wall;                   /* as wall time; 0 if unknown */
    uint64_t sequence;              /* in the store */
    int frame;                      /* the source's number */
    unsigned lost_store, lost_ring; /* frames lost before this one, */
    unsigned lost_encode;           /* by reason */
    uint32_t step;                  /* of an MP4 file: struct mp4_entry */
};

struct frame_queue_frame {
    uint64_t begin, end; /* in the queue's count of bytes */
    struct frame_queue_facts facts;
};

struct frame_queue {
    unsigned char *memory;
    size_t size;
    struct frame_queue_frame *frames;
    unsigned frame_limit;
    uint64_t put, taken;               /* bytes so far */
    uint64_t frames_put, frames_taken; /* frames so far */
    uint64_t cut[FRAME_QUEUE_CUTS];    /* ends of files, in the queue's count */
    unsigned cuts_put, cuts_taken;
    bool closed;
    pthread_mutex_t lock;
    pthread_cond_t changed;
    pthread_t populator;
    bool populating;
    atomic_bool enough;
};

/* Room for `frames` frames of at most `frame_bytes`; the memory is taken in the background. 0 or -errno. */
int frame_queue_init(struct frame_queue *queue, unsigned frames, size_t frame_bytes);
void frame_queue_free(struct frame_queue *queue);

/* How full it is: 0 to 100. */
unsigned frame_queue_level(struct frame_queue *queue);

/* ---- The thread that puts ---- */

/* Whether a frame of that many bytes fits. */
bool frame_queue_has_room(struct frame_queue *queue, size_t bytes);

/* A frame, in pieces. False if there is no room; nothing was put then. */
bool frame_queue_put(struct frame_queue *queue, const struct iovec *pieces, int count,
                     const struct frame_queue_facts *facts);

/* The last frame ends its file. False if there is no room for the rest of the block, or for one more cut. */
bool frame_queue_cut(struct frame_queue *queue);

/* The caller will put no more frames. */
void frame_queue_close(struct frame_queue *queue);

/* ---- The thread that takes ---- */

enum frame_queue_next {
    FRAME_QUEUE_BYTES, /* there are some */
    FRAME_QUEUE_CUT,   /* the file ends here; call frame_queue_next_file() */
    FRAME_QUEUE_END    /* closed and empty */
};

/* The next bytes, at most `limit`; waits for them. They stay in the queue until frame_queue_take(). */
enum frame_queue_next frame_queue_peek(struct frame_queue *queue, const unsigned char **bytes, size_t *size,
                                       size_t limit);
void frame_queue_take(struct frame_queue *queue, size_t bytes);

/* After FRAME_QUEUE_CUT: begin the next file. Return its place in the queue's count. */
uint64_t frame_queue_next_file(struct frame_queue *queue);

/* The oldest frame that has not been dropped yet. False if there is none. */
bool frame_queue_oldest(struct frame_queue *queue, struct frame_queue_frame *frame);
void frame_queue_drop_oldest(struct frame_queue *queue);

#endif
