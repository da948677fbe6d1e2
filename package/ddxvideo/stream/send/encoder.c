/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "encoder.h"

#include <libavutil/error.h>
#include <libavutil/opt.h>
#include <libavutil/rational.h>
#include <limits.h>
#include <string.h>

#include "h264_setup.h"
#include "rtp.h"

/* ---- H.264, each frame one slice: only the first one is a key frame, later ones renew columns of macroblocks ---- */

#define SETS_SECONDS 1           /* s */
#define PERIOD_PICTURES_LEAST 10 /* pictures, of a renewal and between parameter sets */

/*
 * Sizes of frames. x264 has no size for a single frame, but a buffer (VBV) that frames fill and the rate empties. With
 * a buffer of one frame no frame is larger than wanted, at a cost of half a dB; with one of 2.5 frames, several frames
 * are too large after the wanted size falls. So the buffer is one frame when it falls, and grows from then on. Frames
 * are smaller than the buffer allows, hence RATE_RATIO. Measured: docs/bench.md.
 */
#define RATE_RATIO 1.2
#define BUFFER_FRAMES_LEAST 1.0
#define BUFFER_FRAMES_MOST 2.5
#define BUFFER_FRAMES_STEP 0.25
#define FALL_RATIO 0.85    /* of the level; a wanted size below this is a fall */
#define FORGET_SHARE 0.3   /* of the distance from the level to a lower wanted size, each frame */
#define KBIT_MAX 1e6       /* kbit/s */
#define QP_STEP 20         /* from frame to frame; x264's 4 need several frames after a change */
#define RATE_TOLERANCE 0.3 /* of the rate: x264's 1 lets it drift */

static double clip(double value, double least, double most) {
    return value < least ? least : value > most ? most : value;
}

static void set_rate(struct encode_h264 *encoder, double bytes) {
    double rate = clip(bytes * RATE_RATIO * encoder->rate * 8 / 1000, 1, KBIT_MAX);
    bool falls = bytes < FALL_RATIO * encoder->level;

    encoder->buffer = falls ? BUFFER_FRAMES_LEAST
                            : clip(encoder->buffer + BUFFER_FRAMES_STEP, BUFFER_FRAMES_LEAST, BUFFER_FRAMES_MOST);
    if (falls || bytes > encoder->level)
        encoder->level = bytes;
    else
        encoder->level += FORGET_SHARE * (bytes - encoder->level);
    encoder->param.rc.i_bitrate = encoder->param.rc.i_vbv_max_bitrate = (int)rate;
    encoder->param.rc.i_vbv_buffer_size = (int)clip(rate * encoder->buffer / encoder->rate + 0.5, 1, KBIT_MAX);
}

static int pictures_in(const struct encode_h264 *encoder, double seconds) {
    return (int)clip(seconds * encoder->rate, PERIOD_PICTURES_LEAST, 1e6);
}

/*
 * x264 renews a column a picture when encoder_refresh() asks. Where one renewal would take longer than the time from
 * one to the next, at a low rate or for wide pictures, it renews all the time, and as many columns as it must.
 */
static int renewal_pictures(const struct encode_h264 *encoder) {
    int pictures = pictures_in(encoder, ENCODER_RENEWAL_SECONDS);

    return (encoder->param.i_width + 15) / 16 > pictures ? pictures : X264_KEYINT_MAX_INFINITE;
}

/*
 * Without adaptive quantisation and "psy", which makes pictures look sharp: they are closer to the camera's. Without
 * the second analysis of nearly empty blocks, which takes time.
 */
static void set_quality(struct encode_h264 *encoder) {
    x264_param_t *param = &encoder->param;

    param->b_intra_refresh = 1;
    param->i_keyint_max = renewal_pictures(encoder);
    param->analyse.b_psy = 0;
    param->analyse.b_dct_decimate = 0;
    param->rc.i_aq_mode = X264_AQ_NONE;
    param->rc.i_rc_method = X264_RC_ABR;
    param->rc.i_qp_step = QP_STEP;
    param->rc.f_rate_tolerance = RATE_TOLERANCE;
}

static int add_set(struct encode_h264 *encoder, const x264_nal_t *set) {
    size_t size = (size_t)set->i_payload;

    if (size > ENCODE_SETS_MAX - encoder->sets_size)
        return AVERROR_BUFFER_TOO_SMALL;
    memcpy(encoder->sets + encoder->sets_size, set->p_payload, size);
    encoder->sets_size += size;
    return 0;
}

static int take_sets(struct encode_h264 *encoder) {
    x264_nal_t sps, pps;

    if (h264_take_sets(encoder->x264, &sps, &pps))
        return AVERROR_EXTERNAL;
    int error = add_set(encoder, &sps);
    return error ? error : add_set(encoder, &pps);
}

/* `bitrate`: bit/s; `fast`: preset ultrafast. 0, or a negative AVERROR. Close it in any case. */
static int encode_h264_open(struct encode_h264 *encoder, const struct ddxvideo_geometry *geometry, int rate_num,
                            int rate_den, long bitrate, bool fast) {
    struct ddxvideo_geometry coded = *geometry;

    coded.format = DDX_VIDEO_420; /* as the pictures are, whatever layout the store has */
    *encoder = (struct encode_h264){.rate = (double)rate_num / rate_den, .buffer = BUFFER_FRAMES_MOST};
    encoder->bytes = (double)bitrate / 8 / encoder->rate;
    if (h264_set_up(&encoder->param, fast ? "ultrafast" : "superfast", &coded, rate_num, rate_den))
        return AVERROR_EXTERNAL;
    encoder->param.b_annexb = 1;
    set_quality(encoder);
    set_rate(encoder, encoder->bytes);
    encoder->x264 = x264_encoder_open(&encoder->param);
    if (!encoder->x264)
        return AVERROR_EXTERNAL;
    x264_encoder_parameters(encoder->x264, &encoder->param);
    return take_sets(encoder);
}

static void encode_h264_close(struct encode_h264 *encoder) {
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

/* Like encoder_encode(). `number`: of the picture, from 0. `key`: a key frame. */
static int encode_h264_picture(struct encode_h264 *encoder, const struct ddxvideo_picture *picture, int64_t number,
                               bool key, size_t wanted, struct encoded *encoded) {
    x264_picture_t in, out;
    x264_nal_t *nal;
    int count;

    set_rate(encoder, wanted ? (double)wanted : encoder->bytes);
    x264_encoder_reconfig(encoder->x264, &encoder->param);
    h264_set_picture(&in, picture, DDX_VIDEO_420);
    in.i_pts = number;
    in.i_type = key ? X264_TYPE_IDR : X264_TYPE_AUTO;
    int bytes = x264_encoder_encode(encoder->x264, &nal, &count, &in, &out);
    if (bytes <= 0)
        return AVERROR_EXTERNAL;
    encoded->data = nal->p_payload;
    encoded->size = (size_t)bytes;
    if (number < encoder->sets_due && !out.b_keyframe)
        return 0;
    encoder->sets_due = number + pictures_in(encoder, SETS_SECONDS);
    return add_sets(encoder, encoded);
}

/* ---- MPEG-4: a key frame every two seconds, and video packets that fit in RTP packets ---- */

static int limit(int value, int least, int most) {
    return value < least ? least : value > most ? most : value;
}

/*
 * The encoder has no intra refresh, so there are key frames, and the rate is kept over half a second, or two frames if
 * that is longer. It ends a video packet after the macroblock that exceeds the given size, hence the margin.
 */
static int set_mpeg4(AVCodecContext *context, const struct ddxvideo_geometry *geometry, AVRational rate, long bitrate) {
    context->width = geometry->width;
    context->height = geometry->height;
    context->pix_fmt = AV_PIX_FMT_YUV420P;
    context->color_range = geometry->range == DDX_VIDEO_RANGE_FULL ? AVCOL_RANGE_JPEG : AVCOL_RANGE_MPEG;
    context->sample_aspect_ratio = (AVRational){geometry->aspect_num, geometry->aspect_den};
    context->time_base = av_inv_q(rate);
    context->framerate = rate;
    context->bit_rate = context->rc_max_rate = bitrate;
    double buffer = (double)bitrate * (rate.num < 4 * rate.den ? 2.0 * rate.den / rate.num : 0.5);
    context->rc_buffer_size = buffer < INT_MAX ? (int)buffer : INT_MAX;
    context->gop_size = 2 * limit(rate.num / rate.den, 10, 60);
    context->max_b_frames = 0;
    context->thread_count = 1;
    return av_opt_set_int(context, "ps", (RTP_PACKET_MAX - RTP_HEADER_MAX) * 3 / 4, AV_OPT_SEARCH_CHILDREN);
}

/* `bitrate`: bit/s. 0, or a negative AVERROR. Close it in any case. */
static int encode_mpeg4_open(struct encode_mpeg4 *encoder, const struct ddxvideo_geometry *geometry, int rate_num,
                             int rate_den, long bitrate) {
    const AVCodec *codec = avcodec_find_encoder(AV_CODEC_ID_MPEG4);

    *encoder = (struct encode_mpeg4){0};
    if (!codec)
        return AVERROR_ENCODER_NOT_FOUND;
    encoder->context = avcodec_alloc_context3(codec);
    encoder->frame = av_frame_alloc();
    encoder->packet = av_packet_alloc();
    if (!encoder->context || !encoder->frame || !encoder->packet)
        return AVERROR(ENOMEM);
    int error = set_mpeg4(encoder->context, geometry, (AVRational){rate_num, rate_den}, bitrate);
    return error < 0 ? error : avcodec_open2(encoder->context, codec, NULL);
}

static void encode_mpeg4_close(struct encode_mpeg4 *encoder) {
    avcodec_free_context(&encoder->context);
    av_frame_free(&encoder->frame);
    av_packet_free(&encoder->packet);
}

/* Like encoder_encode(). `number`: of the picture, from 0. `key`: make it a key frame. */
static int encode_mpeg4_picture(struct encode_mpeg4 *encoder, const struct ddxvideo_picture *picture, int64_t number,
                                bool key, size_t wanted, struct encoded *encoded) {
    AVCodecContext *context = encoder->context;
    AVFrame *frame = encoder->frame;

    /* The rate at which the encoder's buffer empties may change at any time; bit_rate itself may not. */
    context->rc_max_rate =
        wanted ? (int64_t)wanted * 8 * context->framerate.num / context->framerate.den : context->bit_rate;
    frame->format = context->pix_fmt;
    frame->width = context->width;
    frame->height = context->height;
    frame->color_range = context->color_range;
    frame->pts = number;
    frame->pict_type = key ? AV_PICTURE_TYPE_I : AV_PICTURE_TYPE_NONE;
    for (int i = 0; i < 3; i++) { /* no buffer is needed: libavcodec copies the data that it keeps */
        frame->data[i] = (uint8_t *)(uintptr_t)picture->plane[i];
        frame->linesize[i] = picture->stride[i];
    }
    av_packet_unref(encoder->packet);
    int error = avcodec_send_frame(context, frame);
    if (!error)
        error = avcodec_receive_packet(context, encoder->packet);
    encoded->data = encoder->packet->data;
    encoded->size = (size_t)encoder->packet->size;
    return error;
}

/* ---- Both ---- */

#define RATE_NUMBER_MAX 65535 /* MPEG-4's time base */
#define RATE_DEFAULT 25
#define WARM_WIDTH 352
#define WARM_HEIGHT 288
#define INTERVAL_SECONDS_MOST 10 /* s from frame to frame */

/* Frames per second that both codecs can express. */
static void choose_rate(const struct ddxvideo_geometry *geometry, int *num, int *den) {
    *num = RATE_DEFAULT;
    *den = 1;
    if (geometry->rate_num > 0 && geometry->rate_den > 0)
        av_reduce(num, den, geometry->rate_num, geometry->rate_den, RATE_NUMBER_MAX);
    if (!*num || !*den) /* less than one in 18 hours, or more than the codecs can express */
        *num = *den = 1;
    if (*den / *num > INTERVAL_SECONDS_MOST) { /* at slower rates a frame's size would exceed the codecs' numbers */
        *num = 1;
        *den = INTERVAL_SECONDS_MOST;
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
