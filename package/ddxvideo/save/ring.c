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
    program_thread_ordinary(); /* with priority it would take the processor from who takes frames */
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

/* Bytes in use: a block that was taken in part is. */
static size_t used(const struct ring *ring) {
    return (size_t)(ring->put - ring->taken / RING_BLOCK * RING_BLOCK);
}

unsigned ring_level(struct ring *ring) {
    pthread_mutex_lock(&ring->lock);
    uint64_t bytes = (uint64_t)used(ring) * 100 / ring->size;
    uint64_t frames = (ring->frames_put - ring->frames_taken) * 100 / ring->frame_limit;
    pthread_mutex_unlock(&ring->lock);
    return (unsigned)(bytes > frames ? bytes : frames);
}

static void copy_in(struct ring *ring, uint64_t at, const unsigned char *bytes, size_t size) {
    size_t begin = (size_t)(at % ring->size);
    size_t first = size < ring->size - begin ? size : ring->size - begin;
    memcpy(ring->memory + begin, bytes, first);
    memcpy(ring->memory, bytes + first, size - first);
}

bool ring_put(struct ring *ring, const struct iovec *pieces, int count, const struct ring_facts *facts) {
    size_t bytes = 0;
    for (int i = 0; i < count; i++)
        bytes += pieces[i].iov_len;

    pthread_mutex_lock(&ring->lock);
    bool room = bytes <= ring->size - used(ring) && ring->frames_put - ring->frames_taken < ring->frame_limit;
    pthread_mutex_unlock(&ring->lock);
    if (!room)
        return false;

    /* Outside the lock: nobody looks at free room, and only this thread makes it less. */
    uint64_t begin = ring->put + facts->header, at = ring->put;
    for (int i = 0; i < count; i++) {
        copy_in(ring, at, pieces[i].iov_base, pieces[i].iov_len);
        at += pieces[i].iov_len;
    }

    pthread_mutex_lock(&ring->lock);
    ring->put = at;
    ring->frames[ring->frames_put++ % ring->frame_limit] = (struct ring_frame){begin, at, *facts};
    pthread_cond_signal(&ring->changed);
    pthread_mutex_unlock(&ring->lock);
    return true;
}

bool ring_cut(struct ring *ring) {
    pthread_mutex_lock(&ring->lock);
    size_t rest = (size_t)(-ring->put % RING_BLOCK);
    bool room = rest <= ring->size - used(ring) && ring->cuts_put - ring->cuts_taken < RING_CUTS;
    if (room) {
        ring->cut[ring->cuts_put++ % RING_CUTS] = ring->put;
        ring->put += rest;
    }
    pthread_mutex_unlock(&ring->lock);
    return room;
}

void ring_close(struct ring *ring) {
    pthread_mutex_lock(&ring->lock);
    ring->closed = true;
    pthread_cond_signal(&ring->changed);
    pthread_mutex_unlock(&ring->lock);
}

enum ring_next ring_peek(struct ring *ring, const unsigned char **bytes, size_t *size, size_t limit) {
    pthread_mutex_lock(&ring->lock);
    while (ring->put == ring->taken && ring->cuts_put == ring->cuts_taken && !ring->closed)
        pthread_cond_wait(&ring->changed, &ring->lock);
    bool has_cut = ring->cuts_put != ring->cuts_taken;
    uint64_t end = has_cut ? ring->cut[ring->cuts_taken % RING_CUTS] : ring->put;
    uint64_t ready = end - ring->taken;
    pthread_mutex_unlock(&ring->lock);
    if (!ready)
        return has_cut ? RING_CUT : RING_END;
    size_t begin = (size_t)(ring->taken % ring->size);
    if (limit > ring->size - begin)
        limit = ring->size - begin;
    *bytes = ring->memory + begin;
    *size = ready < limit ? (size_t)ready : limit;
    return RING_BYTES;
}

void ring_take(struct ring *ring, size_t bytes) {
    pthread_mutex_lock(&ring->lock);
    ring->taken += bytes;
    pthread_mutex_unlock(&ring->lock);
}

uint64_t ring_next_file(struct ring *ring) {
    pthread_mutex_lock(&ring->lock);
    ring->cuts_taken++;
    ring->taken += -ring->taken % RING_BLOCK;
    uint64_t begin = ring->taken;
    pthread_mutex_unlock(&ring->lock);
    return begin;
}

bool ring_oldest(struct ring *ring, struct ring_frame *frame) {
    pthread_mutex_lock(&ring->lock);
    bool found = ring->frames_taken < ring->frames_put;
    if (found)
        *frame = ring->frames[ring->frames_taken % ring->frame_limit];
    pthread_mutex_unlock(&ring->lock);
    return found;
}

void ring_drop_oldest(struct ring *ring) {
    pthread_mutex_lock(&ring->lock);
    ring->frames_taken++;
    pthread_mutex_unlock(&ring->lock);
}
