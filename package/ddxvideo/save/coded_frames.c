/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "coded_frames.h"

#include <errno.h>

#include "ddx_time.h"
#include "video_layout.h"

#define KEY_NS SECOND /* from key frame to key frame */

int coded_frames_open(struct coded_frames *frames, const struct ddxvideo_geometry *geometry,
                      const struct h264_settings *settings) {
    *frames = (struct coded_frames){.number = 0};
    int error = h264_encoder_open(&frames->encoder, geometry, settings, &frames->format);

    return error ? error : mp4_write_head(frames->head, &frames->format) ? 0 : -EIO;
}

void coded_frames_close(struct coded_frames *frames) {
    h264_encoder_close(&frames->encoder);
}

size_t coded_frames_room(const struct ddxvideo_geometry *geometry) {
    return 2 * video_layout_bytes(geometry) + H264_ROOM + MP4_FRAGMENT + MP4_BLOCK;
}

bool coded_frames_is_gap(const struct coded_frames *frames, int64_t time) {
    return mp4_times_is_gap(&frames->times, time);
}

void coded_frames_set_quality(struct coded_frames *frames, long quality) {
    h264_encoder_set_quality(&frames->encoder, quality);
}

void coded_frames_next_file(struct coded_frames *frames) {
    frames->number = 0;
    frames->times = (struct mp4_times){.begun = false};
}

/* By capture time. If the clock goes back, players may show the frame elsewhere: it does without the ones before. */
static bool key_is_due(const struct coded_frames *frames, int64_t time) {
    int64_t since = mp4_between(frames->key, time);

    return !frames->number || frames->failed || since < 0 || since >= KEY_NS;
}

int coded_frames_next(struct coded_frames *frames, const struct ddxvideo_picture *picture, struct stamp *stamp,
                      struct coded_frame *frame) {
    uint8_t payload[STAMP_MAX];
    const uint8_t *data;
    size_t size;
    bool first = !frames->number;

    stamp->key = key_is_due(frames, stamp->time);
    stamp->geometry = frames->encoder.geometry;
    frames->failed =
        h264_encode(&frames->encoder, picture, stamp->key, payload, stamp_write(payload, stamp), &data, &size) ||
        size + MP4_FRAGMENT + MP4_BLOCK > coded_frames_room(&frames->encoder.geometry);
    if (frames->failed)
        return -EIO;
    uint32_t step = mp4_times_next(&frames->times, stamp->time);
    mp4_write_fragment(frames->begin, &(struct mp4_fragment){.number = ++frames->number,
                                                             .time = frames->times.shown,
                                                             .duration = frames->format.duration,
                                                             .bytes = (uint32_t)size,
                                                             .key = stamp->key});
    frame->piece[0] = (struct iovec){frames->head, first ? MP4_BLOCK : 0};
    frame->piece[1] = (struct iovec){frames->begin, MP4_FRAGMENT};
    frame->piece[2] = (struct iovec){(void *)(uintptr_t)data, size};
    frame->step = step | (stamp->key ? MP4_KEY : 0);
    if (stamp->key)
        frames->key = stamp->time;
    return 0;
}
