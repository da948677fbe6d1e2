/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The last pictures of a live source, up to a number of frames and of bytes: the oldest ones make room. Positions count
 * all pictures that were added, from 0. One thread adds, another one looks.
 */
#ifndef DDXVIDEO_HISTORY_H
#define DDXVIDEO_HISTORY_H

#include "shot.h"

#define HISTORY_CAME 256

struct history {
    struct shot_pool pool;
    unsigned capacity; /* frames */
    uint64_t limit;    /* bytes */
    /* private: */
    pthread_mutex_t lock;
    struct shot **ring; /* the picture of a position is at position % capacity */
    int64_t oldest, next;
    uint64_t bytes, lost, pending;
    /* The newest pictures that came, whether they are kept or not: a position is at position % HISTORY_CAME. */
    struct {
        int64_t arrival, captured;
    } came[HISTORY_CAME];
};

/* False: no memory. */
bool history_open(struct history *history, unsigned capacity, uint64_t limit);
void history_close(struct history *history);

/*
 * A copy of a picture, for history_add(). The oldest ones make room before, so that the copy has their memory; the
 * newest one stays. NULL: no memory.
 */
struct shot *history_copy(struct history *history, const struct ddxvideo_picture *picture);

/* Takes the reference. A picture that alone is larger than the limit is kept, alone. */
void history_add(struct history *history, struct shot *shot);

/* Frames that came to nothing, though no frame follows them yet. */
void history_lose(struct history *history, uint64_t frames);

/* Frames that have come to nothing since the newest picture: part of what is missing before the next one. */
void history_pend(struct history *history, uint64_t frames);

/* Add the disparities of a frame, by its number, if it is still there. Takes the memory, of malloc(). */
void history_depth(struct history *history, int frame, struct shot_depth *depth);

/* Which positions there are: none while newest is below oldest. */
void history_range(struct history *history, int64_t *oldest, int64_t *newest);

/* The picture at a position; NULL if it is not there. */
struct shot *history_take(struct history *history, int64_t position);

/* When it was captured, ns; 0 if it is not there. */
int64_t history_time(struct history *history, int64_t position);

/* Frames missing so far: those before each picture, those that pend, and what history_lose() was called with. */
uint64_t history_lost(struct history *history);

/*
 * Pictures that came within the last second, a second, whether they are kept or not; 0 once a second has passed without
 * any. Of the last HISTORY_CAME ones, where more came.
 */
double history_rate(struct history *history, int64_t now);

#endif
