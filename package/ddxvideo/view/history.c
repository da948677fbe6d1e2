/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "history.h"

#include <stdlib.h>

#include "ddx_time.h"
#include "video_layout.h"

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
