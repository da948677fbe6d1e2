/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "encode_mpeg4.h"

#include <libavutil/opt.h>
#include <limits.h>

#include "rtp.h"

static int within(int value, int least, int most) {
    return value < least ? least : value > most ? most : value;
}

/*
 * The encoder has no intra refresh, so there are key frames, and the rate is kept over half a second, or two frames if
 * that is longer. It ends a video packet after the macroblock that exceeds the given size, hence the margin.
 */
static int set(AVCodecContext *context, const struct ddxvideo_geometry *geometry, AVRational rate, long bitrate) {
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
    context->gop_size = 2 * within(rate.num / rate.den, 10, 60);
    context->max_b_frames = 0;
    context->thread_count = 1;
    return av_opt_set_int(context, "ps", (RTP_PACKET_MAX - RTP_HEADER_MAX) * 3 / 4, AV_OPT_SEARCH_CHILDREN);
}

int encode_mpeg4_open(struct encode_mpeg4 *encoder, const struct ddxvideo_geometry *geometry, int rate_num,
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
    int error = set(encoder->context, geometry, (AVRational){rate_num, rate_den}, bitrate);
    return error < 0 ? error : avcodec_open2(encoder->context, codec, NULL);
}

void encode_mpeg4_close(struct encode_mpeg4 *encoder) {
    avcodec_free_context(&encoder->context);
    av_frame_free(&encoder->frame);
    av_packet_free(&encoder->packet);
}

int encode_mpeg4_picture(struct encode_mpeg4 *encoder, const struct ddxvideo_picture *picture, int64_t number, bool key,
                         size_t wanted, struct encoded *encoded) {
    AVCodecContext *context = encoder->context;
    AVFrame *frame = encoder->frame;

    /* What empties the encoder's buffer may change at any time; bit_rate itself may not. */
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
