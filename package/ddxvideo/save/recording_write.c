/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The thread between queue and disk. */
#include "recording_write.h"

#include <string.h>

#include "crc32c.h"
#include "program.h"

#define CHUNK (1u << 20) /* writes end at multiples of this, if enough bytes wait */

static void fail(struct recording *recording, int error) {
    int none = 0;

    atomic_compare_exchange_strong(&recording->error, &none, error);
}

/* The frame's last byte was taken from the queue. */
static void frame_is_out(struct recording *recording, const struct frame_queue_frame *frame) {
    if (recording->error) {
        ddx_stats_lost(recording->plan.book, LOST_WRITE, 1);
    } else {
        segment_add(recording->segment, frame, recording->sum);
    }
    recording->sum = 0;
    frame_queue_drop_oldest(&recording->queue);
    ddx_stats_write(recording->plan.book);
}

/* The last byte before the file's first frame was taken. */
static void head_is_out(struct recording *recording) {
    if (recording->segment)
        recording->segment->head = recording->sum;
    recording->sum = 0;
}

/* Assigns bytes that were written, or given up, to their frames. */
static void account(struct recording *recording, const unsigned char *bytes, size_t size) {
    struct frame_queue_frame frame;

    while (size && frame_queue_oldest(&recording->queue, &frame)) {
        bool inside = recording->position >= frame.begin;
        uint64_t left = (inside ? frame.end : frame.begin) - recording->position;
        size_t part = left < size ? (size_t)left : size;

        if (recording->plan.pool)
            recording->sum = crc32c(recording->sum, bytes, part);
        bytes += part;
        size -= part;
        recording->position += part;
        if (!inside && recording->position == frame.begin)
            head_is_out(recording);
        if (recording->position == frame.end)
            frame_is_out(recording, &frame);
    }
}

static void begin_file(struct recording *recording) {
    struct segment *segment;
    const struct ddxvideo_geometry *geometry = &recording->plan.geometry;
    int error = segment_open(recording->plan.output, recording->plan.pool, recording->plan.book, recording->session,
                             &segment);

    if (error) {
        fail(recording, error);
        return;
    }
    if (!*recording->path)
        say("recording %s, %dx%d, to %s", recording->plan.output->name, geometry->width, geometry->height,
            segment->path);
    strcpy(recording->path, segment->path);
    if (recording->plan.pool)
        recording->session = segment->index->header.session;
    segment->begin = recording->position;
    flusher_add(&recording->flusher, segment);
    recording->segment = segment;
}

/* One file ends and another one begins. The flusher must get the new one first: otherwise it would give the old one its
 * name, and the recording would look finished until the new one is on the disk. */
static void change_file(struct recording *recording) {
    struct segment *before = recording->segment;
    uint32_t bit = 1u << recording->queue.cuts_taken % FRAME_QUEUE_CUTS;

    if (recording->begins & bit) {
        recording->begins &= ~bit;
        recording->session = 0; /* the next file has its own */
    }
    recording->position = frame_queue_next_file(&recording->queue);
    recording->segment = NULL;
    if (!recording->error)
        begin_file(recording);
    if (before)
        flusher_close_segment(&recording->flusher, before);
}

/* The previous recording may still be opening its first file, on a disk that hangs. */
static void wait_for_turn(struct recording *recording) {
    struct recording_turn *turn = recording->plan.turn;

    pthread_mutex_lock(&turn->lock);
    while (turn->written < recording->turn)
        pthread_cond_wait(&turn->changed, &turn->lock);
    pthread_mutex_unlock(&turn->lock);
}

static void end_turn(struct recording *recording) {
    struct recording_turn *turn = recording->plan.turn;

    pthread_mutex_lock(&turn->lock);
    turn->written++;
    pthread_cond_broadcast(&turn->changed);
    pthread_mutex_unlock(&turn->lock);
}

void *recording_write(void *argument) {
    struct recording *recording = argument;
    const unsigned char *bytes;
    size_t size, limit = CHUNK;
    enum frame_queue_next next;

    program_thread_signals();
    wait_for_turn(recording);
    while ((next = frame_queue_peek(&recording->queue, &bytes, &size, limit)) != FRAME_QUEUE_END) {
        if (next == FRAME_QUEUE_CUT) {
            change_file(recording);
            limit = CHUNK;
            continue;
        }
        if (!recording->error) { /* otherwise the queue is only emptied, so that each frame is counted */
            ssize_t done = segment_write(recording->segment, bytes, size);
            if (done < 0)
                fail(recording, (int)done);
            else
                size = (size_t)done;
            limit = CHUNK - (size_t)(recording->segment->written % CHUNK);
        }
        account(recording, bytes, size);
        frame_queue_take(&recording->queue, size);
    }
    if (recording->segment) {
        recording->segment->lost_store = recording->lost_store_last;
        recording->segment->lost_ring = recording->lost_ring_last;
        flusher_close_segment(&recording->flusher, recording->segment);
        recording->segment = NULL;
    }
    end_turn(recording);
    flusher_stop(&recording->flusher);
    recording->done = true;
    return NULL;
}
