/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "encoder.h"

#include <libavutil/dict.h>
#include <libavutil/opt.h>
#include <string.h>

#define RATE_MAX 65535 /* MPEG-4's time base */
#define RATE_DEFAULT 25

/*
 * H.264: ultrafast, since a robot's processor has other things to do: arithmetic coding and the deblocking filter would
 * give 0.5 dB for a tenth more of it. Intra refresh instead of large key frames: a column of macroblocks after the
 * other is renewed, all of them within a second. Neither bits spent on what looks sharp, nor a second look at blocks
 * that are nearly empty: without both it takes less time, and the pictures are nearer to the camera's.
 */
static void set_h264(AVCodecContext *context, AVDictionary **options) {
    av_dict_set(options, "preset", "ultrafast", 0);
    av_dict_set(options, "tune", "zerolatency", 0);
    av_dict_set(options, "intra-refresh", "1", 0);
    av_dict_set(options, "x264-params", "no-psy=1:no-dct-decimate=1", 0);
    context->rc_buffer_size = (int)(context->bit_rate * 5 / 2 * context->time_base.num / context->time_base.den);
}

/*
 * MPEG-4: its encoder has no intra refresh, so there are key frames, and the rate is kept over half a second. The
 * encoder ends a video packet after the macroblock that goes beyond the given size, hence the margin.
 */
static void set_mpeg4(AVCodecContext *context, AVDictionary **options, size_t room) {
    av_dict_set_int(options, "ps", (int64_t)(room * 3 / 4), 0);
    context->gop_size *= 2;
    context->rc_buffer_size = (int)(context->bit_rate / 2);
}

static int within(int value, int least, int most) {
    return value < least ? least : value > most ? most : value;
}

static void set_common(AVCodecContext *context, const struct ddxvideo_geometry *geometry, long bitrate) {
    int num = RATE_DEFAULT, den = 1;

    if (geometry->rate_num > 0 && geometry->rate_den > 0)
        av_reduce(&num, &den, geometry->rate_num, geometry->rate_den, RATE_MAX);
    if (!num || !den) /* less than one in 18 hours, or more than the codecs can say */
        num = den = 1;
    context->width = geometry->width;
    context->height = geometry->height;
    context->pix_fmt = AV_PIX_FMT_YUV420P;
    context->color_range = geometry->range == DDX_VIDEO_RANGE_FULL ? AVCOL_RANGE_JPEG : AVCOL_RANGE_MPEG;
    context->sample_aspect_ratio = (AVRational){geometry->aspect_num, geometry->aspect_den};
    context->time_base = (AVRational){den, num};
    context->framerate = (AVRational){num, den};
    context->bit_rate = context->rc_max_rate = bitrate;
    context->gop_size = within(num / den, 10, 60); /* a second's frames */
    context->max_b_frames = 0;
    context->thread_count = 1;
}

int encoder_open(struct encoder *encoder, enum rtp_type type, const struct ddxvideo_geometry *geometry, long bitrate,
                 size_t room) {
    const AVCodec *codec =
        type == RTP_H264 ? avcodec_find_encoder_by_name("libx264") : avcodec_find_encoder(AV_CODEC_ID_MPEG4);
    AVDictionary *options = NULL;

    *encoder = (struct encoder){.type = type, .geometry = *geometry};
    if (!codec)
        return AVERROR_ENCODER_NOT_FOUND;
    encoder->context = avcodec_alloc_context3(codec);
    encoder->frame = av_frame_alloc();
    encoder->packet = av_packet_alloc();
    if (!encoder->context || !encoder->frame || !encoder->packet)
        return AVERROR(ENOMEM);
    set_common(encoder->context, geometry, bitrate);
    if (type == RTP_H264)
        set_h264(encoder->context, &options);
    else
        set_mpeg4(encoder->context, &options, room);
    int error = avcodec_open2(encoder->context, codec, &options);
    if (!error && av_dict_count(options)) /* an option that this FFmpeg does not know would change what we promise */
        error = AVERROR_OPTION_NOT_FOUND;
    av_dict_free(&options);
    return error;
}

void encoder_close(struct encoder *encoder) {
    avcodec_free_context(&encoder->context);
    av_frame_free(&encoder->frame);
    av_packet_free(&encoder->packet);
}

int encoder_encode(struct encoder *encoder, const struct ddxvideo_picture *view, const AVPacket **packet) {
    AVFrame *frame = encoder->frame;

    frame->format = encoder->context->pix_fmt;
    frame->width = encoder->context->width;
    frame->height = encoder->context->height;
    frame->color_range = encoder->context->color_range;
    frame->pts = encoder->count++;
    for (int i = 0; i < 3; i++) { /* without a buffer of its own: libavcodec copies what it keeps */
        frame->data[i] = (uint8_t *)(uintptr_t)view->plane[i];
        frame->linesize[i] = view->stride[i];
    }
    av_packet_unref(encoder->packet);
    int error = avcodec_send_frame(encoder->context, frame);
    if (!error)
        error = avcodec_receive_packet(encoder->context, encoder->packet);
    *packet = encoder->packet;
    return error;
}
