/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "frame_420.h"

#include <libavutil/pixdesc.h>

#include "picture_convert.h"

static const struct {
    enum AVPixelFormat format, result;
} formats[] = {
    {AV_PIX_FMT_YUV420P, AV_PIX_FMT_YUV420P}, {AV_PIX_FMT_YUVJ420P, AV_PIX_FMT_YUVJ420P},
    {AV_PIX_FMT_YUV422P, AV_PIX_FMT_YUV420P}, {AV_PIX_FMT_YUVJ422P, AV_PIX_FMT_YUVJ420P},
    {AV_PIX_FMT_YUV444P, AV_PIX_FMT_YUV420P}, {AV_PIX_FMT_YUVJ444P, AV_PIX_FMT_YUVJ420P},
    {AV_PIX_FMT_GRAY8, AV_PIX_FMT_YUV420P},
};

static enum AVPixelFormat result_of(enum AVPixelFormat format) {
    for (size_t i = 0; i < sizeof formats / sizeof *formats; i++)
        if (formats[i].format == format)
            return formats[i].result;
    return AV_PIX_FMT_NONE;
}

bool frame_420_is_possible(enum AVPixelFormat format) {
    return result_of(format) != AV_PIX_FMT_NONE;
}

int frame_420_weight(enum AVPixelFormat format) {
    return result_of(format) == format || format == AV_PIX_FMT_GRAY8 ? 1 : 2;
}

static bool set_up(struct frame_420 *to, const AVFrame *picture) {
    const AVPixFmtDescriptor *descriptor = av_pix_fmt_desc_get(picture->format);
    bool grey = descriptor->nb_components == 1;
    const struct picture_kind kind = {.bits = 8,
                                      .chroma_x = grey ? -1 : descriptor->log2_chroma_w,
                                      .chroma_y = grey ? -1 : descriptor->log2_chroma_h};
    const struct ddxvideo_geometry geometry = {
        .width = picture->width & ~1, .height = picture->height & ~1, .fields = 1, .format = DDX_VIDEO_420_MPEG2};

    frame_420_close(to);
    to->format = picture->format;
    to->width = picture->width;
    to->height = picture->height;
    to->frame = av_frame_alloc();
    to->converter = geometry.width && geometry.height ? picture_converter_new(&kind, &geometry) : NULL;
    return to->frame && to->converter;
}

/* The previous converted frame may still be in use by the screen. */
static bool renew_frame(struct frame_420 *to, const AVFrame *picture) {
    av_frame_unref(to->frame);
    to->frame->format = result_of(picture->format);
    to->frame->width = picture->width & ~1;
    to->frame->height = picture->height & ~1;
    return !av_frame_get_buffer(to->frame, 0) && !av_frame_copy_props(to->frame, picture);
}

const AVFrame *frame_420(struct frame_420 *to, const AVFrame *picture) {
    if (result_of(picture->format) == picture->format)
        return picture;
    bool same =
        to->converter && to->format == picture->format && to->width == picture->width && to->height == picture->height;
    if (!(same || set_up(to, picture)) || !renew_frame(to, picture))
        return NULL;
    const unsigned char *const from[3] = {picture->data[0], picture->data[1], picture->data[2]};
    return picture_convert(to->converter, from, picture->linesize, to->frame->data, to->frame->linesize) ? to->frame
                                                                                                         : NULL;
}

void frame_420_close(struct frame_420 *to) {
    picture_converter_free(to->converter);
    av_frame_free(&to->frame);
    *to = (struct frame_420){.converter = NULL};
}
