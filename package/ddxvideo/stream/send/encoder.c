/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "encoder.h"

#include <libavutil/rational.h>

#define RATE_MAX 65535 /* MPEG-4's time base */
#define RATE_DEFAULT 25
#define WARM_WIDTH 352
#define WARM_HEIGHT 288
#define SLOWEST 10 /* s from frame to frame */

/* Frames per second that both codecs can express. */
static void choose_rate(const struct ddxvideo_geometry *geometry, int *num, int *den) {
    *num = RATE_DEFAULT;
    *den = 1;
    if (geometry->rate_num > 0 && geometry->rate_den > 0)
        av_reduce(num, den, geometry->rate_num, geometry->rate_den, RATE_MAX);
    if (!*num || !*den) /* less than one in 18 hours, or more than the codecs can express */
        *num = *den = 1;
    if (*den / *num > SLOWEST) { /* at slower rates a frame's size would exceed the codecs' numbers */
        *num = 1;
        *den = SLOWEST;
    }
}

int encoder_open(struct encoder *encoder, const struct encoder_settings *settings,
                 const struct ddxvideo_geometry *geometry) {
    int num, den;

    *encoder = (struct encoder){.type = settings->type, .geometry = *geometry};
    choose_rate(geometry, &num, &den);
    return encoder->type == RTP_H264
               ? encode_h264_open(&encoder->h264, geometry, num, den, settings->bitrate, settings->fast)
               : encode_mpeg4_open(&encoder->mpeg4, geometry, num, den, settings->bitrate);
}

void encoder_close(struct encoder *encoder) {
    encode_h264_close(&encoder->h264);
    encode_mpeg4_close(&encoder->mpeg4);
}

void encoder_warm(const struct encoder_settings *settings) {
    static uint8_t grey[WARM_WIDTH * WARM_HEIGHT];
    const struct ddxvideo_geometry geometry = {.width = WARM_WIDTH, .height = WARM_HEIGHT, .fields = 1};
    const struct ddxvideo_picture picture = {.geometry = geometry,
                                             .plane = {grey, grey, grey},
                                             .stride = {WARM_WIDTH, WARM_WIDTH / 2, WARM_WIDTH / 2},
                                             .rows = {WARM_HEIGHT, WARM_HEIGHT / 2, WARM_HEIGHT / 2}};
    struct encoder encoder;
    struct encoded encoded;

    if (!encoder_open(&encoder, settings, &geometry))
        for (int i = 0; i < 2; i++) /* a key frame, and one that refers to it */
            encoder_encode(&encoder, &picture, 0, &encoded);
    encoder_close(&encoder);
}

bool encoder_is_open(const struct encoder *encoder) {
    return encoder->h264.x264 || encoder->mpeg4.context;
}

int encoder_encode(struct encoder *encoder, const struct ddxvideo_picture *picture, size_t wanted,
                   struct encoded *encoded) {
    int64_t number = encoder->count++;
    bool key = encoder->key;

    encoder->key = false;
    return encoder->type == RTP_H264 ? encode_h264_picture(&encoder->h264, picture, number, key, wanted, encoded)
                                     : encode_mpeg4_picture(&encoder->mpeg4, picture, number, key, wanted, encoded);
}

void encoder_refresh(struct encoder *encoder, bool whole) {
    if (encoder->type == RTP_H264 && !whole)
        x264_encoder_intra_refresh(encoder->h264.x264);
    else
        encoder->key = true;
}
