/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "convert.h"

#include <errno.h>
#include <libavutil/pixdesc.h>
#include <libswscale/swscale.h>
#include <stdlib.h>
#include <string.h>

#include "unpack.h"

#define GREY 128 /* chroma of no colour */

/* Planes of one part of a picture, on either side. */
struct planes {
    unsigned char *data[4];
    int stride[4];
};

/* For pictures of this format; what was there before may do. Grey ones keep their luma, whatever its range. */
static int prepare(struct converter *converter, enum AVPixelFormat format) {
    const struct pixels *from = &converter->from;
    bool grey = format == AV_PIX_FMT_GRAY8;

    if (grey && from->width == converter->width && from->height == converter->height)
        return 0;
    int parts = (int)converter->parts;
    converter->sws = sws_getCachedContext(converter->sws, from->width, from->height / parts, format, converter->width,
                                          converter->height / parts, grey ? AV_PIX_FMT_GRAY8 : AV_PIX_FMT_YUV420P,
                                          SWS_BILINEAR, NULL, NULL, NULL);
    return converter->sws ? 0 : -ENOMEM;
}

int converter_open(struct converter *converter, const struct pixels *from, int width, int height, bool stack) {
    *converter = (struct converter){.from = *from, .width = width, .height = height, .stack = stack};
    converter->format = pixels_find(from->coding);
    if (!converter->format || (stack && from->order == PIXELS_PROGRESSIVE))
        return -EINVAL;
    converter->parts = from->order == PIXELS_PROGRESSIVE ? 1 : 2;
    /* A field has half the rows, and its chroma a quarter. */
    if (converter->parts == 2 && (from->height % 4 || height % 4)) {
        if (stack || from->order != PIXELS_INTERLEAVED)
            return -EINVAL;
        converter->parts = 1;
    }
    if (converter->format->unpack && !(converter->rearranged = malloc(unpack_size(from))))
        return -ENOMEM;
    if (!converter->format->compressed)
        return prepare(converter, converter->format->libav);
    converter->jpeg = jpeg_open();
    return converter->jpeg ? 0 : -ENOMEM;
}

void converter_close(struct converter *converter) {
    jpeg_close(converter->jpeg);
    sws_freeContext(converter->sws);
    free(converter->rearranged);
    memset(converter, 0, sizeof *converter);
}

/* Field `part` (0: the top one) of a picture that has them row by row, or one after the other, from plane to plane. */
static void choose(struct planes *planes, const int rows[3], unsigned part, bool interleaved) {
    for (int i = 0; i < 3; i++) {
        if (!planes->data[i])
            continue;
        planes->data[i] += (ptrdiff_t)part * planes->stride[i] * (interleaved ? 1 : rows[i] / 2);
        planes->stride[i] *= interleaved ? 2 : 1;
    }
}

static void copy_rows(const struct planes *from, const struct planes *to, int width, int height) {
    for (int row = 0; row < height; row++)
        memcpy(to->data[0] + (ptrdiff_t)row * to->stride[0], from->data[0] + (ptrdiff_t)row * from->stride[0],
               (size_t)width);
}

static void convert_part(struct converter *converter, const struct planes *from, const struct planes *to) {
    int rows = (int)converter->parts;

    if (converter->sws)
        sws_scale(converter->sws, (const uint8_t *const *)from->data, from->stride, 0, converter->from.height / rows,
                  to->data, to->stride);
    else
        copy_rows(from, to, converter->width, converter->height / rows);
}

/* The planes of what the camera gave: format and rows of chroma for each, where they lie. */
static int find_planes(struct converter *converter, const void *data, size_t used, struct planes *planes,
                       enum AVPixelFormat *format, int *chroma_rows) {
    const struct pixels *pixels = &converter->from;
    const AVFrame *frame;
    size_t offset[3];

    if (!converter->jpeg) {
        *format = converter->format->libav;
        *chroma_rows = pixels->height / converter->format->chroma_row_step;
        if (used < pixels_planes(pixels, offset, planes->stride))
            return -EBADMSG;
        if (converter->rearranged) {
            unpack_run(pixels, data, converter->rearranged, planes->data, planes->stride);
            return 0;
        }
        for (int i = 0; i < converter->format->planes; i++)
            planes->data[i] = (unsigned char *)(uintptr_t)data + offset[i];
        return 0;
    }
    int error = jpeg_decode(converter->jpeg, data, used, &frame);
    if (error || frame->width != pixels->width || frame->height != pixels->height)
        return -EBADMSG;
    *format = (enum AVPixelFormat)frame->format;
    *chroma_rows = -(-frame->height >> av_pix_fmt_desc_get(*format)->log2_chroma_h);
    for (int i = 0; i < 3; i++) {
        planes->data[i] = frame->data[i];
        planes->stride[i] = frame->linesize[i];
    }
    return prepare(converter, *format);
}

int converter_run(struct converter *converter, const void *data, size_t used, unsigned char *const plane[3],
                  const int stride[3]) {
    const struct pixels *pixels = &converter->from;
    struct planes from = {{NULL}, {0}};
    struct planes to = {{plane[0], plane[1], plane[2], NULL}, {stride[0], stride[1], stride[2], 0}};
    enum AVPixelFormat format;
    int chroma;
    int error = find_planes(converter, data, used, &from, &format, &chroma);

    if (error)
        return error;
    const int from_rows[3] = {pixels->height, chroma, chroma};
    const int to_rows[3] = {converter->height, converter->height / 2, converter->height / 2};
    for (unsigned part = 0; part < converter->parts; part++) {
        struct planes source = from, target = to;

        if (converter->parts == 2) {
            bool first_is_bottom = pixels->order == PIXELS_BOTTOM_TOP;

            choose(&source, from_rows, first_is_bottom ? !part : part, pixels->order == PIXELS_INTERLEAVED);
            choose(&target, to_rows, part, !converter->stack);
        }
        convert_part(converter, &source, &target);
    }
    if (format == AV_PIX_FMT_GRAY8)
        for (int i = 1; i < 3; i++)
            memset(plane[i], GREY, (size_t)stride[i] * (size_t)to_rows[i]);
    return 0;
}
