/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A picture in memory of the viewer's own, with its number, times and disparities. References to a shot are counted:
 * each shot_ref(), and each function that returns a shot, needs a shot_drop(). When other threads can see a shot, its
 * content does not change any more, except that history_depth() adds `depth`.
 */
#ifndef DDXVIDEO_SHOT_H
#define DDXVIDEO_SHOT_H

#include <ddxvideo.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>

/* Disparities of one field, for the range from a stereo pair. */
struct shot_depth {
    int width, height;
    double focal, base;   /* metres = focal * base / disparity */
    uint16_t disparity[]; /* 1/16 pixel; 0: unknown */
};

struct shot_pool;

struct shot {
    struct ddxvideo_picture picture;  /* its planes are in `memory` */
    uint64_t missing;                 /* frames that are missing before this one */
    int64_t arrival;                  /* CLOCK_MONOTONIC, ns */
    struct shot_depth *_Atomic depth; /* NULL: none, or not yet */
    unsigned char *memory;
    size_t size;
    atomic_int references;
    struct shot_pool *pool;
};

/*
 * The memory of the last dropped shot is used for the next one, since new pages would cost as much as the copy. It is
 * kept only while all shots of the pool, this one included, have at most `limit` bytes.
 */
struct shot_pool {
    pthread_mutex_t lock;
    struct shot *spare;
    uint64_t limit, bytes;
};

void shot_pool_open(struct shot_pool *pool, uint64_t limit);
/* Call after all its shots were dropped. */
void shot_pool_close(struct shot_pool *pool);

/* A shot with `size` bytes of memory, and one reference. NULL: no memory. */
struct shot *shot_new(struct shot_pool *pool, size_t size);
/* A copy of a picture. NULL: no memory. */
struct shot *shot_copy(struct shot_pool *pool, const struct ddxvideo_picture *picture);

struct shot *shot_ref(struct shot *shot);
/* NULL is allowed. */
void shot_drop(struct shot *shot);

/* Bytes that it takes. */
size_t shot_bytes(const struct shot *shot);

#endif
