/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "jpeg.h"

#include <ddxvideo.h>
#include <errno.h>
#include <libavcodec/avcodec.h>
#include <limits.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

struct jpeg {
    AVCodecContext *context;
    AVPacket *packet;
    AVFrame *frame;
    bool ends; /* pictures of this camera have an end mark */
};

struct jpeg *jpeg_open(void) {
    struct jpeg *jpeg = calloc(1, sizeof *jpeg);
    const AVCodec *codec = avcodec_find_decoder(AV_CODEC_ID_MJPEG);

    if (!jpeg)
        return NULL;
    jpeg->context = codec ? avcodec_alloc_context3(codec) : NULL;
    jpeg->packet = av_packet_alloc();
    jpeg->frame = av_frame_alloc();
    if (jpeg->context) {
        jpeg->context->thread_count = 1; /* each further thread would delay a frame */
        jpeg->context->max_pixels = (int64_t)DDX_VIDEO_SIDE * DDX_VIDEO_SIDE; /* for any size that the picture claims */
        if (jpeg->packet && jpeg->frame && !avcodec_open2(jpeg->context, codec, NULL))
            return jpeg;
    }
    jpeg_close(jpeg);
    return NULL;
}

void jpeg_close(struct jpeg *jpeg) {
    if (!jpeg)
        return;
    av_frame_free(&jpeg->frame);
    av_packet_free(&jpeg->packet);
    avcodec_free_context(&jpeg->context);
    free(jpeg);
}

/* The same planes by their usual names. */
static bool rename_format(AVFrame *frame) {
    static const enum AVPixelFormat names[][2] = {
        {AV_PIX_FMT_YUVJ420P, AV_PIX_FMT_YUV420P}, {AV_PIX_FMT_YUVJ422P, AV_PIX_FMT_YUV422P},
        {AV_PIX_FMT_YUVJ444P, AV_PIX_FMT_YUV444P}, {AV_PIX_FMT_YUVJ440P, AV_PIX_FMT_YUV440P},
        {AV_PIX_FMT_YUV420P, AV_PIX_FMT_YUV420P},  {AV_PIX_FMT_YUV422P, AV_PIX_FMT_YUV422P},
        {AV_PIX_FMT_YUV444P, AV_PIX_FMT_YUV444P},  {AV_PIX_FMT_GRAY8, AV_PIX_FMT_GRAY8},
    };

    for (unsigned i = 0; i < sizeof names / sizeof *names; i++) {
        if (frame->format == names[i][0]) {
            frame->format = names[i][1];
            return true;
        }
    }
    return false;
}

/* Whether the picture has an end mark, perhaps with padding after it. The coded data cannot have one. */
static bool has_end(const unsigned char *data, size_t size) {
    for (size_t at = size - 1; at > 0; at--)
        if (data[at] == 0xd9 && data[at - 1] == 0xff)
            return true;
    return false;
}

int jpeg_decode(struct jpeg *jpeg, const void *data, size_t size, const AVFrame **frame) {
    /* The decoder reads a little beyond the end, which the driver's buffer may not have. */
    if (size < 4 || size > INT_MAX / 2 || av_new_packet(jpeg->packet, (int)size))
        return -EBADMSG;
    /* The decoder makes up the missing part of a cut picture. Cameras that never set the mark are trusted. */
    bool end = has_end(data, size);
    jpeg->ends |= end;
    if (jpeg->ends && !end) {
        av_packet_unref(jpeg->packet);
        return -EBADMSG;
    }
    memcpy(jpeg->packet->data, data, size);
    int error = avcodec_send_packet(jpeg->context, jpeg->packet);
    av_packet_unref(jpeg->packet);
    if (!error)
        error = avcodec_receive_frame(jpeg->context, jpeg->frame);
    bool damaged = error || jpeg->frame->decode_error_flags || jpeg->frame->flags & AV_FRAME_FLAG_CORRUPT;
    if (damaged || !rename_format(jpeg->frame))
        return -EBADMSG;
    *frame = jpeg->frame;
    return 0;
}
