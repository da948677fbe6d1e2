/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "queue.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ddx_time.h"
#include "program.h"

#define ALIGNMENT 16

static size_t room_for(size_t size) {
    return (sizeof(struct queue_entry) + size + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
}

static struct queue_entry *entry_at(const struct queue *queue, uint64_t at) {
    return (struct queue_entry *)(void *)(queue->memory + at % queue->size);
}

int queue_init(struct queue *queue, size_t size) {
    memset(queue, 0, sizeof *queue);
    queue->size = (size + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    queue->memory = malloc(queue->size);
    if (!queue->memory)
        return -ENOMEM;
    memset(queue->memory, 0, queue->size); /* take the page faults now, not when values are queued */
    pthread_mutex_init(&queue->lock, NULL);
    program_condition(&queue->changed);
    return 0;
}

void queue_free(struct queue *queue) {
    if (!queue->memory)
        return;
    free(queue->memory);
    pthread_mutex_destroy(&queue->lock);
    pthread_cond_destroy(&queue->changed);
}

struct queue_entry *queue_place(struct queue *queue, size_t size) {
    if (size > queue->size)
        return NULL;
    size_t room = room_for(size);
    pthread_mutex_lock(&queue->lock);
    uint64_t taken = queue->taken;
    pthread_mutex_unlock(&queue->lock);
    size_t at = (size_t)(queue->put % queue->size), tail = queue->size - at;
    size_t skipped = tail < room ? tail : 0; /* an entry is contiguous */
    if (room > queue->size || skipped + room > queue->size - (size_t)(queue->put - taken))
        return NULL;
    /* A rest that is smaller than an entry's head needs no mark: both sides skip it. */
    if (skipped >= sizeof(struct queue_entry))
        *entry_at(queue, queue->put) = (struct queue_entry){.room = skipped};
    struct queue_entry *entry = entry_at(queue, queue->put + skipped);
    *entry = (struct queue_entry){.room = room, .size = size};
    queue->fresh = queue->put + skipped + room;
    return entry;
}

void queue_put(struct queue *queue) {
    pthread_mutex_lock(&queue->lock);
    queue->put = queue->fresh;
    pthread_cond_signal(&queue->changed);
    pthread_mutex_unlock(&queue->lock);
}

void queue_close(struct queue *queue) {
    pthread_mutex_lock(&queue->lock);
    queue->closed = true;
    pthread_cond_signal(&queue->changed);
    pthread_mutex_unlock(&queue->lock);
}

struct queue_entry *queue_next(struct queue *queue, int64_t deadline, bool *end) {
    struct timespec until = {.tv_sec = (time_t)(deadline / SECOND), .tv_nsec = (long)(deadline % SECOND)};
    int error = 0;

    pthread_mutex_lock(&queue->lock);
    while (queue->put == queue->taken && !queue->closed && error != ETIMEDOUT)
        error = pthread_cond_timedwait(&queue->changed, &queue->lock, &until);
    bool empty = queue->put == queue->taken;
    *end = empty && queue->closed;
    pthread_mutex_unlock(&queue->lock);
    if (empty)
        return NULL;
    size_t tail = queue->size - (size_t)(queue->taken % queue->size);
    struct queue_entry *entry = entry_at(queue, queue->taken);
    if (tail >= sizeof *entry && entry->item)
        return entry;
    pthread_mutex_lock(&queue->lock);
    queue->taken += tail;
    pthread_mutex_unlock(&queue->lock);
    return entry_at(queue, queue->taken);
}

void queue_take(struct queue *queue) {
    size_t room = entry_at(queue, queue->taken)->room;

    pthread_mutex_lock(&queue->lock);
    queue->taken += room;
    pthread_mutex_unlock(&queue->lock);
}
