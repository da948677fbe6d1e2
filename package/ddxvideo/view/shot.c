/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "shot.h"

#include <stdlib.h>

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
