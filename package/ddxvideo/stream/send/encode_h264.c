/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "encode_h264.h"

#include <libavutil/error.h>
#include <string.h>

#define REFRESH 4       /* s from one renewal of the picture to the next: renewal in each second would cost 1.5 dB */
#define SETS_EVERY 1    /* s */
#define PERIOD_LEAST 10 /* pictures, of both */

/*
 * Sizes of frames. x264 has no size for a single frame, but a buffer (VBV) that frames fill and the rate empties. With
 * a buffer of one frame no frame is larger than wanted, at a cost of half a dB; with one of 2.5 frames, several frames
 * are too large after the wanted size falls. So the buffer is one frame when it falls, and grows from then on. Frames
 * are smaller than the buffer allows, hence MORE. Measured: docs/bench.md.
 */
#define MORE 1.2
#define BUFFER_LEAST 1.0
#define BUFFER_MOST 2.5
#define BUFFER_STEP 0.25
#define FALL 0.85     /* of the level; a wanted size below this is a fall */
#define FORGET 0.3    /* of the distance from the level to a lower wanted size, each frame */
#define RATE_MAX 1e6  /* kbit/s */
#define QP_STEP 20    /* from frame to frame; x264's 4 need several frames after a change */
#define TOLERANCE 0.3 /* of the rate: x264's 1 lets it drift */

static double clip(double value, double least, double most) {
    return value < least ? least : value > most ? most : value;
}

static void set_rate(struct encode_h264 *encoder, double bytes) {
    double rate = clip(bytes * MORE * encoder->rate * 8 / 1000, 1, RATE_MAX);
    bool falls = bytes < FALL * encoder->level;

    encoder->buffer = falls ? BUFFER_LEAST : clip(encoder->buffer + BUFFER_STEP, BUFFER_LEAST, BUFFER_MOST);
    if (falls || bytes > encoder->level)
        encoder->level = bytes;
    else
        encoder->level += FORGET * (bytes - encoder->level);
    encoder->param.rc.i_bitrate = encoder->param.rc.i_vbv_max_bitrate = (int)rate;
    encoder->param.rc.i_vbv_buffer_size = (int)clip(rate * encoder->buffer / encoder->rate + 0.5, 1, RATE_MAX);
}

static int pictures_in(const struct encode_h264 *encoder, double seconds) {
    return (int)clip(seconds * encoder->rate, PERIOD_LEAST, 1e6);
}

/*
 * Without adaptive quantisation and "psy", which makes pictures look sharp: they are closer to the camera's. Without
 * the second analysis of nearly empty blocks, which takes time.
 */
static void set_quality(struct encode_h264 *encoder) {
    x264_param_t *param = &encoder->param;

    param->i_threads = 1;
    param->b_sliced_threads = 0;
    param->i_slice_count = 1;
    param->b_intra_refresh = 1;
    param->i_keyint_max = pictures_in(encoder, REFRESH);
    param->analyse.b_psy = 0;
    param->analyse.b_dct_decimate = 0;
    param->rc.i_aq_mode = X264_AQ_NONE;
    param->rc.i_rc_method = X264_RC_ABR;
    param->rc.i_qp_step = QP_STEP;
    param->rc.f_rate_tolerance = TOLERANCE;
}

static void set_format(x264_param_t *param, const struct ddxvideo_geometry *geometry, int rate_num, int rate_den) {
    param->i_log_level = X264_LOG_ERROR;
    param->i_width = geometry->width;
    param->i_height = geometry->height;
    param->i_csp = X264_CSP_I420;
    param->vui.b_fullrange = geometry->range == DDX_VIDEO_RANGE_FULL;
    param->vui.i_sar_width = geometry->aspect_num;
    param->vui.i_sar_height = geometry->aspect_den;
    param->b_vfr_input = 0;
    param->i_fps_num = param->i_timebase_den = (uint32_t)rate_num;
    param->i_fps_den = param->i_timebase_num = (uint32_t)rate_den;
    param->b_repeat_headers = 0; /* take_sets() has them, without x264's text on its version and settings */
    param->b_annexb = 1;
}

static int take_sets(struct encode_h264 *encoder) {
    x264_nal_t *nal;
    int count;

    if (x264_encoder_headers(encoder->x264, &nal, &count) < 0)
        return AVERROR_EXTERNAL;
    for (; count > 0; count--, nal++) {
        size_t size = (size_t)nal->i_payload;

        if (nal->i_type != NAL_SPS && nal->i_type != NAL_PPS)
            continue;
        if (size > ENCODE_SETS_MAX - encoder->sets_size)
            return AVERROR_BUFFER_TOO_SMALL;
        memcpy(encoder->sets + encoder->sets_size, nal->p_payload, size);
        encoder->sets_size += size;
    }
    return 0;
}

int encode_h264_open(struct encode_h264 *encoder, const struct ddxvideo_geometry *geometry, int rate_num, int rate_den,
                     long bitrate, bool fast) {
    *encoder = (struct encode_h264){.rate = (double)rate_num / rate_den, .buffer = BUFFER_MOST};
    encoder->bytes = (double)bitrate / 8 / encoder->rate;
    if (x264_param_default_preset(&encoder->param, fast ? "ultrafast" : "superfast", "zerolatency") < 0)
        return AVERROR_EXTERNAL;
    set_format(&encoder->param, geometry, rate_num, rate_den);
    set_quality(encoder);
    set_rate(encoder, encoder->bytes);
    encoder->x264 = x264_encoder_open(&encoder->param);
    if (!encoder->x264)
        return AVERROR_EXTERNAL;
    x264_encoder_parameters(encoder->x264, &encoder->param);
    return take_sets(encoder);
}

void encode_h264_close(struct encode_h264 *encoder) {
    if (encoder->x264)
        x264_encoder_close(encoder->x264);
    chunk_free(&encoder->chunk);
    *encoder = (struct encode_h264){0};
}

/* The frame with the parameter sets before it. */
static int add_sets(struct encode_h264 *encoder, struct encoded *encoded) {
    encoder->chunk.size = 0;
    if (!chunk_add(&encoder->chunk, encoder->sets, encoder->sets_size) ||
        !chunk_add(&encoder->chunk, encoded->data, encoded->size))
        return AVERROR(ENOMEM);
    encoded->data = encoder->chunk.data;
    encoded->size = encoder->chunk.size;
    return 0;
}

int encode_h264_picture(struct encode_h264 *encoder, const struct ddxvideo_picture *picture, int64_t number, bool key,
                        size_t wanted, struct encoded *encoded) {
    x264_picture_t in, out;
    x264_nal_t *nal;
    int count;

    set_rate(encoder, wanted ? (double)wanted : encoder->bytes);
    x264_encoder_reconfig(encoder->x264, &encoder->param);
    x264_picture_init(&in);
    in.i_pts = number;
    in.i_type = key ? X264_TYPE_IDR : X264_TYPE_AUTO;
    in.img.i_csp = X264_CSP_I420;
    in.img.i_plane = 3;
    for (int i = 0; i < 3; i++) { /* x264 copies them */
        in.img.plane[i] = (uint8_t *)(uintptr_t)picture->plane[i];
        in.img.i_stride[i] = picture->stride[i];
    }
    int bytes = x264_encoder_encode(encoder->x264, &nal, &count, &in, &out);
    if (bytes <= 0)
        return AVERROR_EXTERNAL;
    encoded->data = nal->p_payload;
    encoded->size = (size_t)bytes;
    if (number < encoder->sets_due && !out.b_keyframe)
        return 0;
    encoder->sets_due = number + pictures_in(encoder, SETS_EVERY);
    return add_sets(encoder, encoded);
}
