/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "recording.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "recording_write.h"
#include "video_layout.h"
#include "y4m.h"

#define NS INT64_C(1000000000)
#define QUEUE_FRAMES 64
#define QUEUE_BYTES_MAX (UINT64_C(256) << 20)
#define QUEUE_FRAMES_MIN 8

static uint64_t memory_share(void) {
    return (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE) / 4;
}

uint64_t recording_queue_bytes_max(void) {
    return memory_share() < QUEUE_BYTES_MAX ? memory_share() : QUEUE_BYTES_MAX;
}

uint64_t recording_frame_memory(const struct ddxvideo_geometry *geometry) {
    return video_layout_bytes(geometry) + Y4M_FRAME_LINE_WRITTEN + sizeof(struct frame_queue_frame);
}

/* 2.5 s. */
static uint64_t usual_frames(const struct ddxvideo_geometry *geometry) {
    if (!ddxvideo_rate_known(geometry->rate_num, geometry->rate_den))
        return QUEUE_FRAMES;
    uint64_t num = (uint64_t)geometry->rate_num, den = (uint64_t)geometry->rate_den;
    uint64_t frames = (UINT64_C(5) * num / 2 + den - 1) / den;
    return frames > QUEUE_FRAMES ? frames : QUEUE_FRAMES;
}

unsigned recording_queue_frames(const struct ddxvideo_geometry *geometry, unsigned asked) {
    uint64_t frames = asked ? asked : usual_frames(geometry);
    uint64_t fits = (asked ? memory_share() : recording_queue_bytes_max()) / recording_frame_memory(geometry);
    uint64_t least = asked && asked < QUEUE_FRAMES_MIN ? asked : QUEUE_FRAMES_MIN;

    if (fits < frames)
        frames = fits;
    return (unsigned)(frames < least ? least : frames);
}

/* ---- Begin and end ---- */

int recording_begin(const struct recording_plan *plan, struct recording **result) {
    struct recording *recording = calloc(1, sizeof *recording);

    if (!recording)
        return -ENOMEM;
    recording->plan = *plan;
    recording->turn = plan->turn->begun;
    recording->lost_store = plan->lost_store;
    recording->lost_ring = plan->lost_ring;
    size_t bytes = video_layout_bytes(&plan->geometry) + Y4M_FRAME_LINE_WRITTEN;
    int error = frame_queue_init(&recording->queue, plan->queue_frames, bytes);
    if (error)
        goto no_queue;
    error = plan->pool && bytes + Y4M_HEADER_WRITTEN > pool_file_bytes(plan->pool) ? -EFBIG : 0;
    if (!error)
        error = flusher_start(&recording->flusher, plan->pool ? NS / 2 : NS * 3 / 4, &recording->error);
    if (error)
        goto no_flusher;
    frame_queue_cut(&recording->queue); /* a file begins: the writing thread opens it, and may wait for the disk */
    error = -pthread_create(&recording->thread, NULL, recording_write, recording);
    if (error)
        goto no_thread;
    plan->turn->begun++;
    *result = recording;
    return 0;

no_thread:
    flusher_stop(&recording->flusher);
no_flusher:
    frame_queue_free(&recording->queue);
no_queue:
    free(recording);
    return error;
}

void recording_close(struct recording *recording) {
    recording->lost_store_last = (uint32_t)recording->lost_store;
    recording->lost_ring_last = (uint32_t)recording->lost_ring;
    frame_queue_close(&recording->queue);
}

bool recording_is_on_disk(const struct recording *recording) {
    return recording->done;
}

int recording_finish(struct recording *recording, char *path) {
    recording_close(recording);
    pthread_join(recording->thread, NULL);
    int error = recording->error;
    strcpy(path, recording->path);
    frame_queue_free(&recording->queue);
    free(recording);
    return error;
}

/* ---- Frame by frame ---- */

/* When a frame was captured; an item without times (the paper's seven fields) has only the time of the write. */
static int64_t capture_time(const struct ddxvideo_picture *view, int64_t published) {
    return view->stamp.time ? view->stamp.time : published;
}

/* Whether the current file has no space for that number of bytes, or for one more frame. */
static bool is_full(const struct recording *recording, size_t bytes) {
    return recording->file_bytes + bytes > pool_file_bytes(recording->plan.pool) ||
           recording->file_frames >= INDEX_ENTRIES;
}

/* Ends the file before the next frame. False if the queue has no room for the end. */
static bool end_file(struct recording *recording) {
    _Static_assert(FRAME_QUEUE_CUTS == 32, "each has a bit");
    uint32_t bit = 1u << recording->queue.cuts_put % FRAME_QUEUE_CUTS;
    if (recording->split)
        recording->begins |= bit; /* before the writing thread can see the cut */
    if (!frame_queue_cut(&recording->queue)) {
        if (recording->split)
            recording->begins &= ~bit;
        return false;
    }
    recording->split = false;
    recording->file_bytes = recording->file_frames = 0;
    return true;
}

static bool refuse(struct recording *recording) {
    ddx_stats_lost(recording->plan.book, LOST_RING, 1);
    recording->lost_ring++;
    return false;
}

bool recording_put(struct recording *recording, const struct ddxvideo_picture *view,
                   const struct recording_frame *frame) {
    char header[Y4M_HEADER_WRITTEN], line[Y4M_FRAME_LINE_WRITTEN];
    size_t bytes = video_layout_bytes(&recording->plan.geometry) + sizeof line;

    recording->lost_store += frame->missed;
    if (recording->plan.pool && recording->file_bytes && (recording->split || is_full(recording, bytes)) &&
        !end_file(recording) && is_full(recording, bytes))
        return refuse(recording);

    struct frame_queue_facts facts = {.published = frame->published,
                                     .time = capture_time(view, frame->published),
                                     .sequence = frame->sequence,
                                     .frame = view->stamp.frame,
                                     .lost_store = (unsigned)recording->lost_store,
                                     .lost_ring = (unsigned)recording->lost_ring};
    if (view->stamp.wall_offset && __builtin_add_overflow(facts.time, view->stamp.wall_offset, &facts.wall))
        facts.wall = 0;
    bool first = !recording->file_bytes;
    if (first) {
        recording->start = facts.time;
        facts.header = (unsigned)y4m_write_header(header, &recording->plan.geometry);
    }
    int64_t time;
    if (__builtin_sub_overflow(facts.time, recording->start, &time) || time < 0)
        time = 0; /* the source's clock went back, which a Y4M file cannot express */
    size_t length = y4m_write_frame(line, time < Y4M_TIME_MAX ? time : Y4M_TIME_MAX, first ? facts.time : 0,
                                    first ? facts.wall : 0);
    struct iovec pieces[5] = {{header, facts.header}, {line, length}};
    size_t total = facts.header + length;
    int count = 2;
    for (int i = 0; i < 3 && view->rows[i]; i++) {
        pieces[count] =
            (struct iovec){(void *)(uintptr_t)view->plane[i], (size_t)view->stride[i] * (size_t)view->rows[i]};
        total += pieces[count++].iov_len;
    }
    if (!frame_queue_put(&recording->queue, pieces, count, &facts))
        return refuse(recording);
    recording->file_bytes += total;
    recording->file_frames++;
    recording->lost_store = recording->lost_ring = 0;
    return true;
}

void recording_split(struct recording *recording) {
    recording->split = recording->file_bytes > 0;
}

void recording_missed(struct recording *recording, uint64_t frames) {
    recording->lost_store += frames;
}

/* ---- State ---- */

const struct ddxvideo_geometry *recording_geometry(const struct recording *recording) {
    return &recording->plan.geometry;
}

uint64_t recording_queue_bytes(const struct recording *recording) {
    return recording->queue.size + recording->queue.frame_limit * sizeof *recording->queue.frames;
}

unsigned recording_level(struct recording *recording) {
    return frame_queue_level(&recording->queue);
}

int recording_error(const struct recording *recording) {
    return recording->error;
}
