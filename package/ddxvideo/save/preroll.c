/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "preroll.h"

#include <stdlib.h>
#include <string.h>

#include "ddx_time.h"
#include "program.h"
#include "video_layout.h"

#define USUAL_RATE 25 /* of a source without a known rate */

static unsigned limit_of(unsigned queue_frames) {
    return queue_frames > 4 ? queue_frames / 4 * 3 : 1;
}

int64_t preroll_seconds_max(const struct ddxvideo_geometry *geometry, unsigned queue_frames) {
    int64_t frames = limit_of(queue_frames);

    return geometry->rate_num > 0 && geometry->rate_den > 0 ? frames * geometry->rate_den / geometry->rate_num
                                                            : frames / USUAL_RATE;
}

struct coded_frames *preroll_encoder(struct preroll *preroll) {
    return preroll->coded && preroll->frames.encoder.x264 ? &preroll->frames : NULL;
}

static uint64_t drop_oldest(struct preroll *preroll) {
    uint64_t frames = 1 + preroll->frame[preroll->oldest].missed;

    preroll->oldest = (preroll->oldest + 1) % preroll->limit;
    preroll->count--;
    return frames;
}

uint64_t preroll_missed_last(struct preroll *preroll) {
    uint64_t frames = preroll->missed;

    preroll->missed = 0;
    return frames;
}

uint64_t preroll_missed(struct preroll *preroll, uint64_t frames) {
    if (!preroll->count)
        return frames;
    preroll->missed += frames;
    return 0;
}

uint64_t preroll_clear(struct preroll *preroll) {
    uint64_t frames = preroll_missed_last(preroll);

    while (preroll->count)
        frames += drop_oldest(preroll);
    free(preroll->picture);
    free(preroll->frame);
    free(preroll->memory);
    free(preroll->coded);
    coded_frames_close(&preroll->frames);
    *preroll = (struct preroll){.seconds = preroll->seconds, .h264 = preroll->h264, .load = preroll->load};
    return frames;
}

/* ---- Encoded ---- */

static bool set_up_coded(struct preroll *preroll, unsigned queue_frames, const struct ddxvideo_picture *view) {
    preroll->bytes = recording_coded_memory(&view->geometry, queue_frames, &preroll->limit) / 4 * 3;
    preroll->limit = preroll->limit / 4 * 3;
    preroll->picture = calloc(preroll->limit, sizeof *preroll->picture);
    preroll->frame = calloc(preroll->limit, sizeof *preroll->frame);
    preroll->coded = calloc(preroll->limit, sizeof *preroll->coded);
    preroll->memory = malloc(preroll->bytes);
    preroll->geometry = view->geometry;
    if (preroll->picture && preroll->frame && preroll->coded && preroll->memory &&
        !coded_frames_open(&preroll->frames, &view->geometry, preroll->h264))
        return true;
    say("no memory for %lld seconds before the start", (long long)preroll->seconds);
    preroll->seconds = 0;
    preroll_clear(preroll);
    return false;
}

static unsigned place(const struct preroll *preroll, unsigned number) {
    return (preroll->oldest + number) % preroll->limit;
}

/* The second key frame; `count` if there is none. */
static unsigned next_key(const struct preroll *preroll) {
    unsigned number = 1;

    while (number < preroll->count && !preroll->coded[place(preroll, number)].key)
        number++;
    return number;
}

/* Drops the oldest pictures up to the next key frame. */
static uint64_t drop_group(struct preroll *preroll) {
    uint64_t frames = 0;

    for (unsigned number = next_key(preroll); number; number--)
        frames += drop_oldest(preroll);
    return frames;
}

/* Finds room for a picture of that size, in one piece. */
static bool find_room(struct preroll *preroll, size_t size) {
    size_t begin = preroll->count ? (size_t)(preroll->coded[preroll->oldest].data - preroll->memory) : 0;

    if (!preroll->count)
        preroll->end = 0;
    if (preroll->count == preroll->limit)
        return false;
    if (preroll->count && preroll->end <= begin)
        return begin - preroll->end >= size;
    if (preroll->bytes - preroll->end >= size)
        return true;
    if (begin < size)
        return false;
    preroll->end = 0;
    return true;
}

/* Whether pictures of this geometry begin another recording than those that wait. */
static bool is_other(const struct preroll *preroll, const struct ddxvideo_geometry *geometry) {
    return !(preroll->coded ? recording_same_header(&preroll->geometry, geometry)
                            : ddxvideo_same_layout(&preroll->geometry, geometry));
}

/* As preroll_put(). The pictures of the wanted seconds stay, and those before, from a key frame on. */
static uint64_t put_coded(struct preroll *preroll, const struct ddxvideo_picture *view,
                          const struct recording_frame *frame) {
    struct coded_picture coded;
    uint64_t gone = 0;
    unsigned next;

    preroll->load->coarse += coded_frames_give_way(&preroll->frames, frame->late);
    int64_t begin = encode_load_now();
    int error = coded_frames_encode(&preroll->frames, view, recording_time(view, frame->published), &coded);
    preroll->load->spent += (uint64_t)(encode_load_now() - begin);
    if (error)
        return preroll_missed(preroll, frame->missed + 1);
    while ((next = next_key(preroll)) < preroll->count &&
           frame->published - preroll->frame[place(preroll, next)].published >= preroll->seconds * SECOND)
        gone += drop_group(preroll);
    while (!find_room(preroll, coded.size) && preroll->count)
        gone += drop_group(preroll);
    if (!preroll->count && (!coded.key || coded.size > preroll->bytes)) { /* what it refers to is gone */
        coded_frames_need_key(&preroll->frames);
        return gone + 1 + frame->missed + preroll_missed_last(preroll);
    }
    unsigned at = place(preroll, preroll->count++);
    memcpy(preroll->memory + preroll->end, coded.data, coded.size);
    preroll->coded[at] = (struct coded_picture){preroll->memory + preroll->end, coded.size, coded.key};
    preroll->end += coded.size;
    preroll->picture[at] = (struct ddxvideo_picture){.geometry = view->geometry, .stamp = view->stamp};
    preroll->frame[at] = *frame;
    preroll->frame[at].missed += preroll_missed_last(preroll);
    return gone;
}

/* Room that a recording needs for the oldest picture, and for those up to the next key frame if it is one. */
static size_t room_for_oldest(const struct preroll *preroll) {
    unsigned last = preroll->coded[preroll->oldest].key ? next_key(preroll) : 1;
    size_t bytes = MP4_BLOCK;

    for (unsigned number = 0; number < last; number++)
        bytes += preroll->coded[place(preroll, number)].size + CODED_EXTRA + mp4_table_room(1) - mp4_table_room(0);
    return bytes;
}

/* ---- As they are ---- */

/* Makes room for pictures of this geometry. */
static bool set_up(struct preroll *preroll, unsigned queue_frames, const struct ddxvideo_picture *view) {
    preroll->limit = limit_of(queue_frames);
    preroll->picture = calloc(preroll->limit, sizeof *preroll->picture);
    preroll->frame = calloc(preroll->limit, sizeof *preroll->frame);
    preroll->bytes = video_layout_bytes(&view->geometry);
    preroll->memory = malloc(preroll->limit * preroll->bytes); /* unused memory costs nothing */
    preroll->geometry = view->geometry;
    if (preroll->seconds > preroll_seconds_max(&view->geometry, queue_frames))
        say("%lld seconds before the start do not fit into memory, only the last %u frames do",
            (long long)preroll->seconds, preroll->limit);
    if (preroll->picture && preroll->frame && preroll->memory)
        return true;
    say("no memory for %lld seconds before the start", (long long)preroll->seconds);
    preroll->seconds = 0;
    preroll_clear(preroll);
    return false;
}

uint64_t preroll_put(struct preroll *preroll, unsigned queue_frames, const struct ddxvideo_picture *view,
                     const struct recording_frame *frame) {
    uint64_t gone = 0;

    if (preroll->memory && (!preroll->seconds || is_other(preroll, &view->geometry)))
        gone = preroll_clear(preroll);
    if (!preroll->seconds || (!preroll->memory && !(preroll->h264 ? set_up_coded(preroll, queue_frames, view)
                                                                  : set_up(preroll, queue_frames, view))))
        return gone + 1 + frame->missed;
    if (preroll->coded)
        return gone + put_coded(preroll, view, frame);
    while (preroll->count && (preroll->count == preroll->limit ||
                              frame->published - preroll->frame[preroll->oldest].published > preroll->seconds * SECOND))
        gone += drop_oldest(preroll);
    unsigned at = (preroll->oldest + preroll->count++) % preroll->limit;
    video_layout_copy(&preroll->picture[at], view, preroll->memory + at * preroll->bytes);
    preroll->frame[at] = *frame;
    preroll->frame[at].missed += preroll_missed_last(preroll);
    return gone;
}

bool preroll_take(struct preroll *preroll, struct ddxvideo_picture *view, struct recording_frame *frame) {
    if (!preroll->count)
        return false;
    *view = preroll->picture[preroll->oldest];
    *frame = preroll->frame[preroll->oldest];
    if (preroll->coded) {
        preroll->taken = (struct recording_encoded){preroll->coded[preroll->oldest], room_for_oldest(preroll)};
        frame->encoded = &preroll->taken;
    }
    drop_oldest(preroll);
    return true;
}
