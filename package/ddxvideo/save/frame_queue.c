/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "frame_queue.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "program.h"

#define ALIGNMENT (1u << 20)

/*
 * The first access to a page costs more than a copy into it, and hundreds of megabytes take longer than the store keeps
 * frames for us. So a separate thread touches the pages ahead of the frames, without changing their contents.
 */
static void *populate(void *argument) {
    struct frame_queue *queue = argument;

    program_thread_signals();
    program_thread_ordinary(); /* with its priority it would delay the thread that takes frames */
    for (size_t at = 0; at < queue->size && !queue->enough; at += ALIGNMENT)
        if (madvise(queue->memory + at, ALIGNMENT, MADV_POPULATE_WRITE))
            break; /* a kernel before 5.14: then the frames touch them */
    return NULL;
}

int frame_queue_init(struct frame_queue *queue, unsigned frames, size_t frame_bytes) {
    memset(queue, 0, sizeof *queue);
    if (!frames || frame_bytes > (SIZE_MAX - 2 * ALIGNMENT) / frames)
        return -ENOMEM;
    queue->size = (frames * frame_bytes + ALIGNMENT) / ALIGNMENT * ALIGNMENT; /* room for a header as well */
    queue->frame_limit = frames;
    queue->frames = calloc(frames, sizeof *queue->frames);
    queue->memory = mmap(NULL, queue->size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (!queue->frames || queue->memory == MAP_FAILED) {
        free(queue->frames);
        if (queue->memory != MAP_FAILED)
            munmap(queue->memory, queue->size);
        return -ENOMEM;
    }
    pthread_mutex_init(&queue->lock, NULL);
    pthread_cond_init(&queue->changed, NULL);
    queue->populating = !pthread_create(&queue->populator, NULL, populate, queue);
    return 0;
}

void frame_queue_free(struct frame_queue *queue) {
    queue->enough = true;
    if (queue->populating)
        pthread_join(queue->populator, NULL);
    munmap(queue->memory, queue->size);
    free(queue->frames);
    pthread_mutex_destroy(&queue->lock);
    pthread_cond_destroy(&queue->changed);
}

/* Bytes in use, blocks that were taken in part included. */
static size_t used(const struct frame_queue *queue) {
    return (size_t)(queue->put - queue->taken / FRAME_QUEUE_BLOCK * FRAME_QUEUE_BLOCK);
}

unsigned frame_queue_level(struct frame_queue *queue) {
    pthread_mutex_lock(&queue->lock);
    uint64_t bytes = (uint64_t)used(queue) * 100 / queue->size;
    uint64_t frames = (queue->frames_put - queue->frames_taken) * 100 / queue->frame_limit;
    pthread_mutex_unlock(&queue->lock);
    return (unsigned)(bytes > frames ? bytes : frames);
}

static void copy_in(struct frame_queue *queue, uint64_t at, const unsigned char *bytes, size_t size) {
    size_t begin = (size_t)(at % queue->size);
    size_t first = size < queue->size - begin ? size : queue->size - begin;

    memcpy(queue->memory + begin, bytes, first);
    memcpy(queue->memory, bytes + first, size - first);
}

bool frame_queue_has_room(struct frame_queue *queue, size_t bytes) {
    pthread_mutex_lock(&queue->lock);
    bool room = bytes <= queue->size - used(queue) && queue->frames_put - queue->frames_taken < queue->frame_limit;
    pthread_mutex_unlock(&queue->lock);
    return room;
}

bool frame_queue_put(struct frame_queue *queue, const struct iovec *pieces, int count,
                     const struct frame_queue_facts *facts) {
    size_t bytes = 0;

    for (int i = 0; i < count; i++)
        bytes += pieces[i].iov_len;

    if (!frame_queue_has_room(queue, bytes))
        return false;

    /* Outside the lock: no other thread reads the free space, and only this thread reduces it. */
    uint64_t begin = queue->put + facts->header, at = queue->put;
    for (int i = 0; i < count; i++) {
        copy_in(queue, at, pieces[i].iov_base, pieces[i].iov_len);
        at += pieces[i].iov_len;
    }

    pthread_mutex_lock(&queue->lock);
    queue->put = at;
    queue->frames[queue->frames_put++ % queue->frame_limit] = (struct frame_queue_frame){begin, at, *facts};
    pthread_cond_signal(&queue->changed);
    pthread_mutex_unlock(&queue->lock);
    return true;
}

bool frame_queue_cut(struct frame_queue *queue) {
    pthread_mutex_lock(&queue->lock);
    size_t rest = (size_t)(-queue->put % FRAME_QUEUE_BLOCK);
    bool room = rest <= queue->size - used(queue) && queue->cuts_put - queue->cuts_taken < FRAME_QUEUE_CUTS;
    if (room) {
        queue->cut[queue->cuts_put++ % FRAME_QUEUE_CUTS] = queue->put;
        queue->put += rest;
    }
    pthread_mutex_unlock(&queue->lock);
    return room;
}

void frame_queue_close(struct frame_queue *queue) {
    pthread_mutex_lock(&queue->lock);
    queue->closed = true;
    pthread_cond_signal(&queue->changed);
    pthread_mutex_unlock(&queue->lock);
}

enum frame_queue_next frame_queue_peek(struct frame_queue *queue, const unsigned char **bytes, size_t *size,
                                       size_t limit) {
    pthread_mutex_lock(&queue->lock);
    while (queue->put == queue->taken && queue->cuts_put == queue->cuts_taken && !queue->closed)
        pthread_cond_wait(&queue->changed, &queue->lock);
    bool has_cut = queue->cuts_put != queue->cuts_taken;
    uint64_t end = has_cut ? queue->cut[queue->cuts_taken % FRAME_QUEUE_CUTS] : queue->put;
    uint64_t ready = end - queue->taken;
    pthread_mutex_unlock(&queue->lock);
    if (!ready)
        return has_cut ? FRAME_QUEUE_CUT : FRAME_QUEUE_END;
    size_t begin = (size_t)(queue->taken % queue->size);
    if (limit > queue->size - begin)
        limit = queue->size - begin;
    *bytes = queue->memory + begin;
    *size = ready < limit ? (size_t)ready : limit;
    return FRAME_QUEUE_BYTES;
}

void frame_queue_take(struct frame_queue *queue, size_t bytes) {
    pthread_mutex_lock(&queue->lock);
    queue->taken += bytes;
    pthread_mutex_unlock(&queue->lock);
}

uint64_t frame_queue_next_file(struct frame_queue *queue) {
    pthread_mutex_lock(&queue->lock);
    queue->cuts_taken++;
    queue->taken += -queue->taken % FRAME_QUEUE_BLOCK;
    uint64_t begin = queue->taken;
    pthread_mutex_unlock(&queue->lock);
    return begin;
}

bool frame_queue_oldest(struct frame_queue *queue, struct frame_queue_frame *frame) {
    pthread_mutex_lock(&queue->lock);
    bool found = queue->frames_taken < queue->frames_put;
    if (found)
        *frame = queue->frames[queue->frames_taken % queue->frame_limit];
    pthread_mutex_unlock(&queue->lock);
    return found;
}

void frame_queue_drop_oldest(struct frame_queue *queue) {
    pthread_mutex_lock(&queue->lock);
    queue->frames_taken++;
    pthread_mutex_unlock(&queue->lock);
}
