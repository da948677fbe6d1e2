/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "jpeg.h"

#include <errno.h>
#include <libavcodec/avcodec.h>
#include <libavutil/opt.h>
#include <libswscale/swscale.h>
#include <stdbool.h>

/* An even side, as 4:2:0 needs it. */
static int divided(int side, int divisor) {
    int result = side / divisor & ~1;

    return result ? result : 2;
}

/* Limited range becomes full range, which JPEG has; an unknown range counts as limited. */
static int set_up_scaler(struct jpeg_encoder *encoder, const struct ddxvideo_geometry *from) {
    const bool full = from->range == DDX_VIDEO_RANGE_FULL;

    if (full && encoder->form.divisor == 1)
        return 0;
    struct SwsContext *scaler = encoder->scaler = sws_alloc_context();
    const struct {
        const char *name;
        int64_t value;
    } settings[] = {{"srcw", from->width},
                    {"srch", from->height},
                    {"src_format", AV_PIX_FMT_YUV420P},
                    {"src_range", full},
                    {"dstw", encoder->codec->width},
                    {"dsth", encoder->codec->height},
                    {"dst_format", AV_PIX_FMT_YUV420P},
                    {"dst_range", 1},
                    {"sws_flags", SWS_BILINEAR | SWS_ACCURATE_RND}};
    for (size_t i = 0; scaler && i < sizeof settings / sizeof *settings; i++)
        if (av_opt_set_int(scaler, settings[i].name, settings[i].value, 0) < 0)
            return -ENOMEM;
    return scaler && sws_init_context(scaler, NULL, NULL) >= 0 ? 0 : -ENOMEM;
}

static int set_up(struct jpeg_encoder *encoder, const struct ddxvideo_geometry *from, const struct jpeg_form *form) {
    const AVCodec *codec = avcodec_find_encoder(AV_CODEC_ID_MJPEG);

    if (!codec)
        return -EIO;
    encoder->form = *form;
    encoder->frame = av_frame_alloc();
    encoder->packet = av_packet_alloc();
    AVCodecContext *context = encoder->codec = avcodec_alloc_context3(codec);
    if (!context || !encoder->frame || !encoder->packet)
        return -ENOMEM;
    context->width = encoder->frame->width = divided(from->width, form->divisor);
    context->height = encoder->frame->height = divided(from->height, form->divisor);
    context->pix_fmt = AV_PIX_FMT_YUV420P;
    context->color_range = encoder->frame->color_range = AVCOL_RANGE_JPEG;
    encoder->frame->format = AV_PIX_FMT_YUV420P;
    encoder->frame->pts = 0;
    encoder->frame->quality = form->quality * FF_QP2LAMBDA;
    context->time_base = (AVRational){1, 1};
    context->thread_count = 1;
    context->flags |= AV_CODEC_FLAG_QSCALE;
    context->global_quality = encoder->frame->quality;
    if (avcodec_open2(context, codec, NULL))
        return -EIO;
    int error = set_up_scaler(encoder, from);
    if (!error && encoder->scaler && av_frame_get_buffer(encoder->frame, 0))
        error = -ENOMEM;
    return error;
}

/* Fill the frame with the picture, or with pointers to its planes. */
static int fill(struct jpeg_encoder *encoder, const struct ddxvideo_picture *picture) {
    AVFrame *frame = encoder->frame;

    if (!encoder->scaler) {
        for (int i = 0; i < 3; i++) {
            frame->data[i] = (uint8_t *)picture->plane[i]; /* which the encoder reads only */
            frame->linesize[i] = picture->stride[i];
        }
        return 0;
    }
    if (av_frame_make_writable(frame) < 0) /* the encoder may still have a reference */
        return -ENOMEM;
    int rows = sws_scale(encoder->scaler, picture->plane, picture->stride, 0, picture->geometry.height, frame->data,
                         frame->linesize);
    return rows == frame->height ? 0 : -EIO;
}

/* Everything but the picture converter, which notices a change itself. */
static void forget(struct jpeg_encoder *encoder) {
    struct as_420 as = encoder->as;

    sws_freeContext(encoder->scaler);
    avcodec_free_context(&encoder->codec);
    av_frame_free(&encoder->frame);
    av_packet_free(&encoder->packet);
    *encoder = (struct jpeg_encoder){.as = as};
}

int jpeg_encode(struct jpeg_encoder *encoder, const struct ddxvideo_picture *picture, const struct jpeg_form *form,
                const unsigned char **bytes, size_t *size) {
    const struct ddxvideo_picture *from;
    int error = as_420(&encoder->as, picture, &from);

    if (error)
        return error;
    if (!encoder->codec || encoder->form.quality != form->quality || encoder->form.divisor != form->divisor ||
        !ddxvideo_same_layout(&encoder->from, &from->geometry)) {
        forget(encoder);
        error = set_up(encoder, &from->geometry, form);
        encoder->from = from->geometry;
    }
    if (!error)
        error = fill(encoder, from);
    if (!error) {
        encoder->frame->pts++; /* the encoder refuses one that it had */
        av_packet_unref(encoder->packet);
        if (avcodec_send_frame(encoder->codec, encoder->frame) ||
            avcodec_receive_packet(encoder->codec, encoder->packet))
            error = -EIO;
    }
    if (error) {
        forget(encoder);
        return error;
    }
    *bytes = encoder->packet->data;
    *size = (size_t)encoder->packet->size;
    return 0;
}

void jpeg_close(struct jpeg_encoder *encoder) {
    forget(encoder);
    as_420_close(&encoder->as);
}
