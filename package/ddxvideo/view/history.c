/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "history.h"

#include <stdlib.h>

#include "ddx_time.h"
#include "video_layout.h"

void shot_pool_open(struct shot_pool *pool, uint64_t limit) {
    *pool = (struct shot_pool){.limit = limit};
    pthread_mutex_init(&pool->lock, NULL);
}

static void shot_free(struct shot *shot) {
    if (!shot)
        return;
    free(shot->memory);
    free(shot);
}

void shot_pool_close(struct shot_pool *pool) {
    shot_free(pool->spare);
    pthread_mutex_destroy(&pool->lock);
}

/* The spare shot, if it has this size; otherwise a new one, which the pool then counts. */
static struct shot *take_spare(struct shot_pool *pool, size_t size) {
    struct shot *shot = NULL;

    pthread_mutex_lock(&pool->lock);
    if (pool->spare && pool->spare->size == size) {
        shot = pool->spare;
        pool->spare = NULL;
    } else {
        pool->bytes += size;
    }
    pthread_mutex_unlock(&pool->lock);
    return shot;
}

struct shot *shot_new(struct shot_pool *pool, size_t size) {
    struct shot *shot = take_spare(pool, size);
    unsigned char *memory = shot ? shot->memory : malloc(size);

    if (!shot)
        shot = memory ? malloc(sizeof *shot) : NULL;
    if (!shot) {
        free(memory);
        pthread_mutex_lock(&pool->lock);
        pool->bytes -= size;
        pthread_mutex_unlock(&pool->lock);
        return NULL;
    }
    *shot = (struct shot){.memory = memory, .size = size, .pool = pool};
    atomic_init(&shot->references, 1);
    return shot;
}

struct shot *shot_copy(struct shot_pool *pool, const struct ddxvideo_picture *picture) {
    struct shot *shot = shot_new(pool, video_layout_bytes(&picture->geometry));

    if (shot)
        video_layout_copy(&shot->picture, picture, shot->memory);
    return shot;
}

struct shot *shot_ref(struct shot *shot) {
    atomic_fetch_add(&shot->references, 1);
    return shot;
}

void shot_drop(struct shot *shot) {
    if (!shot || atomic_fetch_sub(&shot->references, 1) > 1)
        return;
    struct shot_pool *pool = shot->pool;
    free(shot->depth);
    shot->depth = NULL;
    pthread_mutex_lock(&pool->lock);
    bool kept = pool->bytes <= pool->limit;
    struct shot *former = kept ? pool->spare : shot;
    if (kept)
        pool->spare = shot;
    pool->bytes -= former ? former->size : 0;
    pthread_mutex_unlock(&pool->lock);
    shot_free(former);
}

size_t shot_bytes(const struct shot *shot) {
    const struct shot_depth *depth = shot->depth;

    return sizeof *shot + shot->size + (depth ? 2 * (size_t)depth->width * (size_t)depth->height : 0);
}

bool history_open(struct history *history, unsigned capacity, uint64_t limit) {
    *history = (struct history){.capacity = capacity, .limit = limit};
    history->ring = calloc(capacity, sizeof *history->ring);
    shot_pool_open(&history->pool, limit);
    pthread_mutex_init(&history->lock, NULL);
    return history->ring;
}

static struct shot **place(struct history *history, int64_t position) {
    return &history->ring[position % history->capacity];
}

static bool has(const struct history *history, int64_t position) {
    return position >= history->oldest && position < history->next;
}

static struct shot *take_oldest(struct history *history) {
    struct shot *shot = *place(history, history->oldest++);

    history->bytes -= shot_bytes(shot);
    return shot;
}

void history_close(struct history *history) {
    while (history->ring && history->oldest < history->next)
        shot_drop(take_oldest(history));
    free(history->ring);
    shot_pool_close(&history->pool);
    pthread_mutex_destroy(&history->lock);
}

/* Makes room for a picture of `bytes` bytes; at least `least` pictures stay. */
static void make_room(struct history *history, size_t bytes, int64_t least) {
    while (history->next - history->oldest > least &&
           (history->next - history->oldest >= history->capacity || history->bytes + bytes > history->limit))
        shot_drop(take_oldest(history));
}

struct shot *history_copy(struct history *history, const struct ddxvideo_picture *picture) {
    pthread_mutex_lock(&history->lock);
    make_room(history, sizeof(struct shot) + video_layout_bytes(&picture->geometry), 1);
    pthread_mutex_unlock(&history->lock);
    return shot_copy(&history->pool, picture);
}

void history_add(struct history *history, struct shot *shot) {
    pthread_mutex_lock(&history->lock);
    make_room(history, shot_bytes(shot), 0);
    history->bytes += shot_bytes(shot);
    history->lost += shot->missing;
    history->pending = 0;
    history->came[history->next % HISTORY_CAME].arrival = shot->arrival;
    history->came[history->next % HISTORY_CAME].captured = shot->picture.stamp.time;
    *place(history, history->next++) = shot;
    pthread_mutex_unlock(&history->lock);
}

void history_lose(struct history *history, uint64_t frames) {
    pthread_mutex_lock(&history->lock);
    history->lost += frames;
    pthread_mutex_unlock(&history->lock);
}

void history_pend(struct history *history, uint64_t frames) {
    pthread_mutex_lock(&history->lock);
    history->pending = frames;
    pthread_mutex_unlock(&history->lock);
}

void history_depth(struct history *history, int frame, struct shot_depth *depth) {
    pthread_mutex_lock(&history->lock);
    for (int64_t at = history->next - 1; at >= history->oldest && depth; at--) {
        struct shot *shot = *place(history, at);

        if (shot->picture.stamp.frame != frame || shot->depth)
            continue;
        history->bytes -= shot_bytes(shot);
        shot->depth = depth;
        history->bytes += shot_bytes(shot);
        depth = NULL;
    }
    pthread_mutex_unlock(&history->lock);
    free(depth);
}

void history_range(struct history *history, int64_t *oldest, int64_t *newest) {
    pthread_mutex_lock(&history->lock);
    *oldest = history->oldest;
    *newest = history->next - 1;
    pthread_mutex_unlock(&history->lock);
}

struct shot *history_take(struct history *history, int64_t position) {
    pthread_mutex_lock(&history->lock);
    struct shot *shot = has(history, position) ? shot_ref(*place(history, position)) : NULL;
    pthread_mutex_unlock(&history->lock);
    return shot;
}

int64_t history_time(struct history *history, int64_t position) {
    pthread_mutex_lock(&history->lock);
    int64_t time = has(history, position) ? (*place(history, position))->picture.stamp.time : 0;
    pthread_mutex_unlock(&history->lock);
    return time;
}

uint64_t history_lost(struct history *history) {
    pthread_mutex_lock(&history->lock);
    uint64_t lost = history->lost + history->pending;
    pthread_mutex_unlock(&history->lock);
    return lost;
}

double history_rate(struct history *history, int64_t now) {
    int64_t last = 0, first = 0; /* times of capture, since frames that waited on their way arrive all at once */
    int count = 0;

    pthread_mutex_lock(&history->lock);
    for (int64_t at = history->next - 1; at >= 0 && count < HISTORY_CAME; at--) {
        if (now - history->came[at % HISTORY_CAME].arrival > SECOND)
            break;
        first = history->came[at % HISTORY_CAME].captured;
        last = count ? last : first;
        count++;
    }
    pthread_mutex_unlock(&history->lock);
    return count > 1 && last > first ? (count - 1) * (double)SECOND / (double)(last - first) : count;
}
