/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "convert.h"

#include <errno.h>
#include <libavcodec/avcodec.h>
#include <libavutil/opt.h>
#include <libavutil/pixdesc.h>
#include <libswscale/swscale.h>
#include <limits.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "pixels.h"

/* ---- JPEG ---- */

struct jpeg {
    AVCodecContext *context;
    AVPacket *packet;
    AVFrame *frame;
    bool ends; /* pictures of this camera have an end mark */
};

/* NULL is allowed. */
static void jpeg_close(struct jpeg *jpeg) {
    if (!jpeg)
        return;
    av_frame_free(&jpeg->frame);
    av_packet_free(&jpeg->packet);
    avcodec_free_context(&jpeg->context);
    free(jpeg);
}

/* NULL: libavcodec has no JPEG decoder, or no memory. */
static struct jpeg *jpeg_open(void) {
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

/*
 * Decode a picture. 0, and its planes in *frame until the next call; their format is without the letter J, and the
 * range is always the full one. -EBADMSG: damaged, or of an unsupported kind.
 */
static int jpeg_decode(struct jpeg *jpeg, const void *data, size_t size, const AVFrame **frame) {
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

/* ---- Conversion ---- */

#define GREY 128  /* chroma without a colour */
#define VECTOR 64 /* bytes of the largest vector of any processor */

/* Planes of one part of a picture, input or output. */
struct planes {
    unsigned char *data[4];
    int stride[4];
};

/* ---- Pictures between two steps ---- */

static void picture_free(struct picture *picture) {
    for (int i = 0; i < 3; i++)
        free(picture->plane[i]);
    *picture = (struct picture){0};
}

static int picture_make(struct picture *picture, const struct video_layout *layout, int width, int height) {
    picture_free(picture);
    for (int i = 0; i < 3; i++) {
        int bytes, rows;

        video_layout_plane(layout, (width + 1) & ~1, (height + 1) & ~1, i, &bytes, &rows);
        picture->stride[i] = (bytes + 2 * VECTOR - 1) / VECTOR * VECTOR;
        if (!rows)
            continue;
        picture->plane[i] = aligned_alloc(VECTOR, (size_t)picture->stride[i] * (size_t)rows);
        if (!picture->plane[i])
            return -ENOMEM;
    }
    return 0;
}

static struct planes planes_of(const struct picture *picture) {
    struct planes planes = {{NULL}, {0}};

    memcpy(planes.data, picture->plane, sizeof picture->plane);
    memcpy(planes.stride, picture->stride, sizeof picture->stride);
    return planes;
}

/* ---- Preparation ---- */

static enum AVPixelFormat libav_of(const struct video_layout *layout) {
    switch (layout->format) {
    case DDX_VIDEO_YUV422P: return AV_PIX_FMT_YUV422P;
    case DDX_VIDEO_YUV444P: return AV_PIX_FMT_YUV444P;
    case DDX_VIDEO_GREY8: return AV_PIX_FMT_GRAY8;
    case DDX_VIDEO_GREY16: return AV_PIX_FMT_GRAY16LE;
    case DDX_VIDEO_RGB24: return AV_PIX_FMT_RGB24;
    default: return AV_PIX_FMT_YUV420P;
    }
}

static int open_scaler(struct converter *converter, enum AVPixelFormat source, enum AVPixelFormat target) {
    bool rgb = target == AV_PIX_FMT_RGB24;
    const struct {
        const char *name;
        int64_t value;
    } settings[] = {
        {"srcw", converter->from.width},
        {"srch", converter->from.height / (int)converter->parts},
        {"src_format", source},
        {"src_range", rgb && converter->direct.full}, /* otherwise the range does not change */
        {"dstw", converter->width},
        {"dsth", converter->height / (int)converter->parts},
        {"dst_format", target},
        {"dst_range", rgb},
        /* Accurate rounding: the code for each processor gives the same samples. */
        {"sws_flags", SWS_BILINEAR | SWS_ACCURATE_RND | (rgb ? SWS_FULL_CHR_H_INT : 0)},
    };

    struct SwsContext *sws = converter->sws = sws_alloc_context();
    if (!sws)
        return -ENOMEM;
    for (size_t i = 0; i < sizeof settings / sizeof *settings; i++)
        if (av_opt_set_int(sws, settings[i].name, settings[i].value, 0) < 0)
            return -EINVAL;
    return sws_init_context(sws, NULL, NULL) < 0 ? -ENOMEM : 0;
}

/*
 * Raw sensor pictures become RGB in a separate step. libswscale's direct conversion to 4:2:0 takes chroma of each
 * second row in FFmpeg 5.1 and the mean of both rows in 7.1, but results must not depend on the version of the image.
 */
static int open_bayer(struct converter *converter) {
    int width = converter->from.width, height = converter->from.height;

    if (!(av_pix_fmt_desc_get(converter->libav)->flags & AV_PIX_FMT_FLAG_BAYER))
        return 0;
    converter->bayer = sws_getContext(width, height, converter->libav, width, height, AV_PIX_FMT_RGB24,
                                      SWS_BILINEAR | SWS_ACCURATE_RND, NULL, NULL, NULL);
    if (!converter->bayer)
        return -ENOMEM;
    converter->libav = AV_PIX_FMT_RGB24;
    return picture_make(&converter->coloured, video_layout_of(DDX_VIDEO_RGB24), width, height);
}

static void forget(struct converter *converter) {
    sws_freeContext(converter->sws);
    converter->sws = NULL;
    picture_free(&converter->taken);
    picture_free(&converter->scaled);
    converter->prepared = AV_PIX_FMT_NONE;
}

/* 4:2:0 is scaled in place; grey keeps its luma in any range. */
static int prepare_420(struct converter *converter, enum AVPixelFormat format) {
    bool grey = format == AV_PIX_FMT_GRAY8;

    converter->before = converter->after = NULL;
    return open_scaler(converter, format, grey ? AV_PIX_FMT_GRAY8 : AV_PIX_FMT_YUV420P);
}

/*
 * Other layouts are scaled in the layout itself, if rows can be converted to it before. Grey from RGB is made by way of
 * 4:2:0, whose luma has the same range.
 */
static int prepare_other(struct converter *converter, enum AVPixelFormat format) {
    const struct video_layout *layout = converter->layout, *between = layout;
    enum AVPixelFormat source = converter->before ? libav_of(layout) : format;
    bool grey = layout->chroma_x < 0 && layout->samples == 1;
    int error = 0;

    if (grey && !converter->before)
        between = video_layout_of(DDX_VIDEO_420);
    converter->after = direct_find(libav_of(between), layout);
    if (converter->before)
        error = picture_make(&converter->taken, layout, converter->from.width, converter->from.height);
    if (!error)
        error = picture_make(&converter->scaled, between, converter->width, converter->height);
    return error ? error : open_scaler(converter, source, libav_of(between));
}

/* Prepares for pictures of this format, if it is not prepared already. */
static int prepare(struct converter *converter, enum AVPixelFormat format) {
    bool same = converter->from.width == converter->width && converter->from.height == converter->height;

    if (format == converter->prepared)
        return 0;
    forget(converter);
    int error = 0;
    converter->before = direct_find(format, converter->layout);
    if (!converter->before || !same)
        error = video_layout_is_420(converter->layout->format) ? prepare_420(converter, format)
                                                               : prepare_other(converter, format);
    if (error)
        forget(converter);
    else
        converter->prepared = format;
    return error;
}

int converter_open(struct converter *converter, const struct pixels *from, int range,
                   const struct ddxvideo_geometry *to, bool stack) {
    *converter = (struct converter){.from = *from,
                                    .width = to->width,
                                    .height = to->height,
                                    .layout = video_layout_of(to->format),
                                    .stack = stack,
                                    .prepared = AV_PIX_FMT_NONE,
                                    .direct = {.depth = from->depth, .full = range == DDX_VIDEO_RANGE_FULL}};
    converter->format = pixels_find(from->coding);
    if (!converter->format || !converter->layout || (stack && from->order == PIXELS_PROGRESSIVE))
        return -EINVAL;
    converter->parts = from->order == PIXELS_PROGRESSIVE ? 1 : 2;
    /* A field has half the rows, and its chroma a quarter. */
    if (converter->parts == 2 && (from->height % 4 || to->height % 4)) {
        if (stack || from->order != PIXELS_INTERLEAVED)
            return -EINVAL;
        converter->parts = 1;
    }
    bool deep = converter->layout->bytes == 2 && converter->format->deep != AV_PIX_FMT_NONE;
    converter->libav = deep ? converter->format->deep : converter->format->libav;
    if (converter->format->unpack && !deep && !(converter->unpacked = malloc(unpack_size(from) + VECTOR)))
        return -ENOMEM;
    if (!converter->format->compressed) {
        int error = open_bayer(converter);

        return error ? error : prepare(converter, converter->libav);
    }
    converter->jpeg = jpeg_open();
    return converter->jpeg ? 0 : -ENOMEM;
}

void converter_close(struct converter *converter) {
    jpeg_close(converter->jpeg);
    forget(converter);
    sws_freeContext(converter->bayer);
    picture_free(&converter->coloured);
    free(converter->unpacked);
    memset(converter, 0, sizeof *converter);
}

/* ---- Picture by picture ---- */

/* Selects field `part` (0: the top one) in each plane, whose fields are interleaved, or follow each other. */
static void choose(struct planes *planes, const int rows[3], unsigned part, bool interleaved) {
    for (int i = 0; i < 3; i++) {
        if (!planes->data[i])
            continue;
        planes->data[i] += (ptrdiff_t)part * planes->stride[i] * (interleaved ? 1 : rows[i] / 2);
        planes->stride[i] *= interleaved ? 2 : 1;
    }
}

static void run_rows(struct converter *converter, direct_row *row, int width, int rows, struct planes from,
                     struct planes to) {
    converter->direct.width = width;
    for (int number = 0; number < rows; number++) {
        row(&converter->direct, (const unsigned char *const *)from.data, to.data);
        for (int i = 0; i < 3; i++) {
            from.data[i] += from.data[i] ? from.stride[i] : 0;
            to.data[i] += to.data[i] ? to.stride[i] : 0;
        }
    }
}

static void convert_part(struct converter *converter, const struct planes *from, const struct planes *to) {
    int rows = converter->from.height / (int)converter->parts, to_rows = converter->height / (int)converter->parts;
    struct planes taken = planes_of(&converter->taken), scaled = planes_of(&converter->scaled);

    if (converter->before)
        run_rows(converter, converter->before, converter->from.width, rows, *from, converter->sws ? taken : *to);
    if (!converter->sws)
        return;
    const struct planes *source = converter->before ? &taken : from, *target = converter->after ? &scaled : to;
    sws_scale(converter->sws, (const uint8_t *const *)source->data, source->stride, 0, rows, target->data,
              target->stride);
    if (converter->after)
        run_rows(converter, converter->after, converter->width, to_rows, scaled, *to);
}

/* Finds the planes in the camera's buffer; samples that libswscale cannot read are rearranged first. */
static int find_samples(struct converter *converter, const void *data, size_t used, struct planes *planes) {
    size_t offset[3];

    if (used < pixels_planes(&converter->from, offset, planes->stride))
        return -EBADMSG;
    if (converter->unpacked)
        unpack_run(&converter->from, data, converter->unpacked, planes->data, planes->stride);
    else
        for (int i = 0; i < converter->format->planes; i++)
            planes->data[i] = (unsigned char *)(uintptr_t)data + offset[i];
    if (converter->bayer) {
        struct planes raw = *planes;

        *planes = planes_of(&converter->coloured);
        sws_scale(converter->bayer, (const uint8_t *const *)raw.data, raw.stride, 0, converter->from.height,
                  planes->data, planes->stride);
    }
    return 0;
}

/* Finds the planes of the input, their format, and the rows of chroma. */
static int find_planes(struct converter *converter, const void *data, size_t used, struct planes *planes,
                       enum AVPixelFormat *format, int *chroma_rows) {
    const struct pixels *pixels = &converter->from;
    const AVFrame *frame;

    if (!converter->jpeg) {
        *format = converter->libav;
        *chroma_rows = pixels->height / converter->format->chroma_row_step;
        return find_samples(converter, data, used, planes);
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
    int to_rows[3], bytes;
    for (int i = 0; i < 3; i++)
        video_layout_plane(converter->layout, converter->width, converter->height, i, &bytes, &to_rows[i]);
    for (unsigned part = 0; part < converter->parts; part++) {
        struct planes source = from, target = to;

        if (converter->parts == 2) {
            bool first_is_bottom = pixels->order == PIXELS_BOTTOM_TOP;

            choose(&source, from_rows, first_is_bottom ? !part : part, pixels->order == PIXELS_INTERLEAVED);
            choose(&target, to_rows, part, !converter->stack);
        }
        convert_part(converter, &source, &target);
    }
    if (format == AV_PIX_FMT_GRAY8 && video_layout_is_420(converter->layout->format))
        for (int i = 1; i < 3; i++)
            memset(plane[i], GREY, (size_t)stride[i] * (size_t)to_rows[i]);
    return 0;
}
