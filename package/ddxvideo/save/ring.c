/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "ring.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "program.h"

#define ALIGNMENT (1u << 20)

/*
 * The first touch of a page costs more than copying into it, and hundreds of megabytes take longer than the store keeps
 * frames for us. So a thread of its own touches the pages, ahead of the frames; what is in them stays.
 */
static void *populate(void *argument) {
    struct ring *ring = argument;
    program_thread_signals();
    for (size_t at = 0; at < ring->size && !ring->enough; at += ALIGNMENT)
        if (madvise(ring->memory + at, ALIGNMENT, MADV_POPULATE_WRITE))
            break; /* a kernel before 5.14: the frames touch them, then */
    return NULL;
}

int ring_init(struct ring *ring, unsigned frames, size_t frame_bytes) {
    memset(ring, 0, sizeof(*ring));
    if (!frames || frame_bytes > (SIZE_MAX - 2 * ALIGNMENT) / frames)
        return -ENOMEM;
    ring->size = (frames * frame_bytes + ALIGNMENT) / ALIGNMENT * ALIGNMENT; /* room for a header as well */
    ring->frame_limit = frames;
    ring->frames = calloc(frames, sizeof(*ring->frames));
    ring->memory = mmap(NULL, ring->size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (!ring->frames || ring->memory == MAP_FAILED) {
        free(ring->frames);
        if (ring->memory != MAP_FAILED)
            munmap(ring->memory, ring->size);
        return -ENOMEM;
    }
    pthread_mutex_init(&ring->lock, NULL);
    pthread_cond_init(&ring->changed, NULL);
    ring->populating = !pthread_create(&ring->populator, NULL, populate, ring);
    return 0;
}

void ring_free(struct ring *ring) {
    ring->enough = true;
    if (ring->populating)
        pthread_join(ring->populator, NULL);
    munmap(ring->memory, ring->size);
    free(ring->frames);
    pthread_mutex_destroy(&ring->lock);
    pthread_cond_destroy(&ring->changed);
}

static void copy_in(struct ring *ring, uint64_t at, const unsigned char *bytes, size_t size) {
    size_t begin = (size_t)(at % ring->size);
    size_t first = size < ring->size - begin ? size : ring->size - begin;
    memcpy(ring->memory + begin, bytes, first);
    memcpy(ring->memory, bytes + first, size - first);
}

static bool put(struct ring *ring, const struct iovec *pieces, int count, const int64_t *stamp) {
    size_t bytes = 0;
    for (int i = 0; i < count; i++)
        bytes += pieces[i].iov_len;

    pthread_mutex_lock(&ring->lock);
    bool room = bytes <= ring->size - (size_t)(ring->put - ring->taken) &&
                (!stamp || ring->frames_put - ring->frames_taken < ring->frame_limit);
    pthread_mutex_unlock(&ring->lock);
    if (!room)
        return false;

    /* Outside the lock: nobody looks at free room, and only this thread makes it less. */
    uint64_t at = ring->put;
    for (int i = 0; i < count; i++) {
        copy_in(ring, at, pieces[i].iov_base, pieces[i].iov_len);
        at += pieces[i].iov_len;
    }

    pthread_mutex_lock(&ring->lock);
    ring->put = at;
    if (stamp)
        ring->frames[ring->frames_put++ % ring->frame_limit] = (struct ring_frame){at, *stamp};
    pthread_cond_signal(&ring->changed);
    pthread_mutex_unlock(&ring->lock);
    return true;
}

bool ring_put_bytes(struct ring *ring, const void *bytes, size_t size) {
    const struct iovec piece = {(void *)(uintptr_t)bytes, size};
    return put(ring, &piece, 1, NULL);
}

bool ring_put(struct ring *ring, const struct iovec *pieces, int count, int64_t stamp) {
    return put(ring, pieces, count, &stamp);
}

void ring_close(struct ring *ring) {
    pthread_mutex_lock(&ring->lock);
    ring->closed = true;
    pthread_cond_signal(&ring->changed);
    pthread_mutex_unlock(&ring->lock);
}

size_t ring_peek(struct ring *ring, const unsigned char **bytes, size_t limit) {
    pthread_mutex_lock(&ring->lock);
    while (ring->put == ring->taken && !ring->closed)
        pthread_cond_wait(&ring->changed, &ring->lock);
    uint64_t ready = ring->put - ring->taken;
    size_t begin = (size_t)(ring->taken % ring->size);
    pthread_mutex_unlock(&ring->lock);
    *bytes = ring->memory + begin;
    if (limit > ring->size - begin)
        limit = ring->size - begin;
    return ready < limit ? (size_t)ready : limit;
}

void ring_take(struct ring *ring, size_t bytes) {
    pthread_mutex_lock(&ring->lock);
    ring->taken += bytes;
    pthread_mutex_unlock(&ring->lock);
}

bool ring_next_frame(struct ring *ring, struct ring_frame *frame) {
    pthread_mutex_lock(&ring->lock);
    const struct ring_frame *next = &ring->frames[ring->frames_taken % ring->frame_limit];
    bool whole = ring->frames_taken < ring->frames_put && next->end <= ring->taken;
    if (whole) {
        *frame = *next;
        ring->frames_taken++;
    }
    pthread_mutex_unlock(&ring->lock);
    return whole;
}
