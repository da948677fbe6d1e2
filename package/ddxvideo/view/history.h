/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Pictures in memory: a shot is one picture, a history has the last pictures of a live source. */
#ifndef DDXVIDEO_HISTORY_H
#define DDXVIDEO_HISTORY_H

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

/*
 * A picture in memory of the viewer's own, with its number, times and disparities. References to a shot are counted:
 * each shot_ref(), and each function that returns a shot, needs a shot_drop(). When other threads can see a shot, its
 * content does not change any more, except that history_depth() adds `depth`.
 */
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

#define HISTORY_CAME 256

/*
 * The last pictures of a live source, up to a number of frames and of bytes; then the oldest pictures are dropped.
 * Positions count all added pictures, from 0. One thread adds pictures, another one reads them.
 */
struct history {
    struct shot_pool pool;
    unsigned capacity; /* frames */
    uint64_t limit;    /* bytes */
    /* private: */
    pthread_mutex_t lock;
    struct shot **ring; /* the picture of a position is at position % capacity */
    int64_t oldest, next;
    uint64_t bytes, lost, pending;
    /* The newest pictures, dropped ones included: a position is at position % HISTORY_CAME. */
    struct {
        int64_t arrival, captured;
    } came[HISTORY_CAME];
};

/* False: no memory. */
bool history_open(struct history *history, unsigned capacity, uint64_t limit);
void history_close(struct history *history);

/*
 * Copy a picture for history_add(). The oldest pictures are dropped first, so that the copy gets their memory; the
 * newest picture stays. NULL: no memory.
 */
struct shot *history_copy(struct history *history, const struct ddxvideo_picture *picture);

/* Takes the reference. If one picture alone is larger than the limit, only that picture is kept. */
void history_add(struct history *history, struct shot *shot);

/* Report frames that were lost, before another frame has come. */
void history_lose(struct history *history, uint64_t frames);

/* Frames that were lost since the newest picture. They count as missing before the next one. */
void history_pend(struct history *history, uint64_t frames);

/* Add the disparities of a frame, by its number, if it is still kept. Takes the memory, which is from malloc(). */
void history_depth(struct history *history, int frame, struct shot_depth *depth);

/* The kept positions. There are none while newest is below oldest. */
void history_range(struct history *history, int64_t *oldest, int64_t *newest);

/* The picture at a position; NULL if it is not kept. */
struct shot *history_take(struct history *history, int64_t position);

/* The time of capture, ns; 0 if the picture is not kept. */
int64_t history_time(struct history *history, int64_t position);

/* All missing frames so far: before each picture, since the newest one, and those of history_lose(). */
uint64_t history_lost(struct history *history);

/*
 * The rate, from the pictures of the last second, dropped ones included; 0 if none has come for a second. If more than
 * HISTORY_CAME came, only the last HISTORY_CAME of them count.
 */
double history_rate(struct history *history, int64_t now);

#endif
