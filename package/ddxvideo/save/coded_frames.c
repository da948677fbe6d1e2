/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "coded_frames.h"

#include <errno.h>

#include "ddx_time.h"
#include "video_layout.h"

#define KEY_NS SECOND /* from key frame to key frame */

#define COARSER 8   /* in crf: half of the bits, and of the time */
#define GIVE_WAY 50 /* % */
#define GIVEN_WAY 25

int coded_frames_open(struct coded_frames *frames, const struct ddxvideo_geometry *geometry,
                      const struct h264_settings *settings) {
    *frames = (struct coded_frames){.begins = true, .quality = settings->quality};
    int error = h264_encoder_open(&frames->encoder, geometry, settings, &frames->format);

    return error ? error : mp4_write_head(frames->head, &frames->format) ? 0 : -EIO;
}

void coded_frames_close(struct coded_frames *frames) {
    h264_encoder_close(&frames->encoder);
}

size_t coded_frames_room(const struct ddxvideo_geometry *geometry) {
    return 2 * video_layout_bytes(geometry) + H264_ROOM + CODED_EXTRA + MP4_BLOCK;
}

bool coded_frames_is_gap(const struct coded_frames *frames, int64_t time) {
    return mp4_times_is_gap(&frames->times, time);
}

bool coded_frames_give_way(struct coded_frames *frames, unsigned percent) {
    bool coarse = frames->quality && (percent >= GIVE_WAY || (frames->coarse && percent >= GIVEN_WAY));

    if (coarse != frames->coarse)
        h264_encoder_set_quality(&frames->encoder, coarse ? frames->quality + COARSER : frames->quality);
    frames->coarse = coarse;
    return coarse;
}

void coded_frames_need_key(struct coded_frames *frames) {
    frames->begins = true;
}

void coded_frames_next_file(struct coded_frames *frames) {
    frames->number = 0;
    frames->times = (struct mp4_times){.begun = false};
    frames->begins = true;
}

/* By capture time. If the clock goes back, players may show the frame elsewhere: it does without the ones before. */
static bool key_is_due(const struct coded_frames *frames, int64_t time) {
    int64_t since = mp4_between(frames->key, time);

    return frames->begins || since < 0 || since >= KEY_NS;
}

int coded_frames_encode(struct coded_frames *frames, const struct ddxvideo_picture *picture, int64_t time,
                        struct coded_picture *coded) {
    coded->key = key_is_due(frames, time);
    frames->begins = h264_encode(&frames->encoder, picture, coded->key, &coded->data, &coded->size) ||
                     coded->size + CODED_EXTRA + MP4_BLOCK > coded_frames_room(&frames->encoder.geometry);
    if (frames->begins)
        return -EIO;
    if (coded->key)
        frames->key = time;
    return 0;
}

void coded_frames_add(struct coded_frames *frames, const struct coded_picture *coded, struct stamp *stamp,
                      struct coded_frame *frame) {
    bool first = !frames->number;

    stamp->key = coded->key;
    stamp->geometry = frames->encoder.geometry;
    size_t stamp_size = stamp_write_nal(frames->stamp, stamp);
    uint32_t step = mp4_times_next(&frames->times, stamp->time);
    mp4_write_fragment(frames->begin, &(struct mp4_fragment){.number = ++frames->number,
                                                             .time = frames->times.shown,
                                                             .duration = frames->format.duration,
                                                             .bytes = (uint32_t)(stamp_size + coded->size),
                                                             .key = coded->key});
    frame->piece[0] = (struct iovec){frames->head, first ? MP4_BLOCK : 0};
    frame->piece[1] = (struct iovec){frames->begin, MP4_FRAGMENT};
    frame->piece[2] = (struct iovec){frames->stamp, stamp_size};
    frame->piece[3] = (struct iovec){(void *)(uintptr_t)coded->data, coded->size};
    frame->bytes = frame->piece[0].iov_len + MP4_FRAGMENT + stamp_size + coded->size;
    frame->step = step | (coded->key ? MP4_KEY : 0);
}
