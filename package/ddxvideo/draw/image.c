/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "image.h"

#include <errno.h>
#include <libavcodec/avcodec.h>
#include <libavutil/pixdesc.h>
#include <libswscale/swscale.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "picture_convert.h"
#include "video_layout.h"

#define QUALITY 3 /* of JPEG: from 1, the best, to 31, the smallest file */
#define BLACK_LEVEL 0
#define SCALE_FLAGS (SWS_BICUBIC | SWS_ACCURATE_RND | SWS_FULL_CHR_H_INT)

enum image_format image_format_of(const char *path) {
    static const struct {
        const char *name;
        enum image_format format;
    } known[] = {{".ppm", IMAGE_PPM}, {".png", IMAGE_PNG}, {".jpg", IMAGE_JPEG}, {".jpeg", IMAGE_JPEG}};
    const char *dot = strrchr(path, '.');

    for (size_t i = 0; dot && i < sizeof known / sizeof *known; i++)
        if (!strcasecmp(dot, known[i].name))
            return known[i].format;
    return IMAGE_UNKNOWN;
}

AVFrame *image_new(int width, int height) {
    AVFrame *image = av_frame_alloc();

    if (!image)
        return NULL;
    image->format = AV_PIX_FMT_RGB24;
    image->width = width;
    image->height = height;
    image->color_range = AVCOL_RANGE_JPEG;
    if (av_frame_get_buffer(image, 0)) {
        av_frame_free(&image);
        return NULL;
    }
    memset(image->data[0], BLACK_LEVEL, (size_t)image->linesize[0] * (size_t)height);
    return image;
}

static enum AVPixelFormat pixel_format(const struct video_layout *layout) {
    if (layout->samples == 3)
        return AV_PIX_FMT_RGB24;
    if (layout->chroma_x == 0)
        return AV_PIX_FMT_YUV444P;
    return layout->chroma_y == 0 ? AV_PIX_FMT_YUV422P : AV_PIX_FMT_YUV420P;
}

static int draw(AVFrame *image, const struct ddxvideo_picture *picture, int x, int y, int width, int height) {
    const struct ddxvideo_geometry *from = &picture->geometry;
    const bool full = from->range == DDX_VIDEO_RANGE_FULL;
    const int *matrix = sws_getCoefficients(SWS_CS_ITU601);
    struct SwsContext *context = sws_getContext(from->width, from->height, pixel_format(video_layout_of(from->format)),
                                                width, height, AV_PIX_FMT_RGB24, SCALE_FLAGS, NULL, NULL, NULL);

    if (!context)
        return -ENOMEM;
    sws_setColorspaceDetails(context, matrix, full, matrix, 1, 0, 1 << 16, 1 << 16);
    uint8_t *target[4] = {image->data[0] + y * image->linesize[0] + 3 * x};
    const int target_stride[4] = {image->linesize[0]};
    int rows = sws_scale(context, picture->plane, picture->stride, 0, from->height, target, target_stride);
    sws_freeContext(context);
    return rows == height ? 0 : -EIO;
}

/* Grey as RGB: libswscale knows grey of full range only. */
static int draw_grey(AVFrame *image, const struct ddxvideo_picture *picture, int x, int y, int width, int height) {
    const struct picture_kind kind = picture_kind_of(&picture->geometry);
    struct ddxvideo_picture rgb = {.geometry = picture->geometry};
    int error = -ENOMEM;

    rgb.geometry.format = DDX_VIDEO_RGB24;
    video_layout_plane(video_layout_of(DDX_VIDEO_RGB24), rgb.geometry.width, rgb.geometry.height, 0, &rgb.stride[0],
                       &rgb.rows[0]);
    unsigned char *plane[3] = {malloc(video_layout_bytes(&rgb.geometry) + PICTURE_READ_BEYOND)};
    struct picture_converter *converter = picture_converter_new(&kind, &rgb.geometry);
    if (converter && plane[0] && picture_convert(converter, picture->plane, picture->stride, plane, rgb.stride)) {
        rgb.plane[0] = plane[0];
        error = draw(image, &rgb, x, y, width, height);
    }
    picture_converter_free(converter);
    free(plane[0]);
    return error;
}

int image_draw(AVFrame *image, const struct ddxvideo_picture *picture, int x, int y, int width, int height) {
    const struct video_layout *layout = video_layout_of(picture->geometry.format);
    bool grey = layout->chroma_x < 0 && layout->samples == 1;

    return grey ? draw_grey(image, picture, x, y, width, height) : draw(image, picture, x, y, width, height);
}

/* ---- Files ---- */

static int write_ppm(const AVFrame *image, FILE *file) {
    fprintf(file, "P6\n%d %d\n255\n", image->width, image->height);
    for (int row = 0; row < image->height; row++)
        fwrite(image->data[0] + row * (ptrdiff_t)image->linesize[0], 3, (size_t)image->width, file);
    return 0;
}

/* JPEG wants full-range YUV. NULL: no memory. */
static AVFrame *for_jpeg(const AVFrame *image) {
    AVFrame *frame = av_frame_alloc();
    struct SwsContext *context = sws_getContext(image->width, image->height, AV_PIX_FMT_RGB24, image->width,
                                                image->height, AV_PIX_FMT_YUV420P, SCALE_FLAGS, NULL, NULL, NULL);

    if (frame && context) {
        const int *matrix = sws_getCoefficients(SWS_CS_ITU601);

        sws_setColorspaceDetails(context, matrix, 1, matrix, 1, 0, 1 << 16, 1 << 16);
        frame->format = AV_PIX_FMT_YUV420P;
        frame->color_range = AVCOL_RANGE_JPEG;
        frame->width = image->width;
        frame->height = image->height;
        frame->quality = QUALITY * FF_QP2LAMBDA;
    }
    if (!frame || !context || av_frame_get_buffer(frame, 0) ||
        sws_scale(context, (const uint8_t *const *)image->data, image->linesize, 0, image->height, frame->data,
                  frame->linesize) != image->height)
        av_frame_free(&frame);
    sws_freeContext(context);
    return frame;
}

static int encode(const AVFrame *frame, enum AVCodecID id, FILE *file) {
    const AVCodec *codec = avcodec_find_encoder(id);
    AVCodecContext *context = codec ? avcodec_alloc_context3(codec) : NULL;
    AVPacket *packet = av_packet_alloc();
    int error = codec ? -ENOMEM : -EOPNOTSUPP;

    if (context && packet) {
        context->width = frame->width;
        context->height = frame->height;
        context->pix_fmt = (enum AVPixelFormat)frame->format;
        context->color_range = frame->color_range;
        context->time_base = (AVRational){1, 1};
        context->thread_count = 1;
        if (frame->quality) {
            context->flags |= AV_CODEC_FLAG_QSCALE;
            context->global_quality = frame->quality;
        }
        error = avcodec_open2(context, codec, NULL) || avcodec_send_frame(context, frame) ||
                        avcodec_receive_packet(context, packet)
                    ? -EIO
                    : 0;
    }
    if (!error)
        fwrite(packet->data, 1, (size_t)packet->size, file);
    av_packet_free(&packet);
    avcodec_free_context(&context);
    return error;
}

static int write_image(const AVFrame *image, enum image_format format, FILE *file) {
    if (format == IMAGE_PPM)
        return write_ppm(image, file);
    if (format == IMAGE_PNG)
        return encode(image, AV_CODEC_ID_PNG, file);
    AVFrame *frame = for_jpeg(image);
    int error = frame ? encode(frame, AV_CODEC_ID_MJPEG, file) : -ENOMEM;
    av_frame_free(&frame);
    return error;
}

int image_save(const AVFrame *image, enum image_format format, const char *path) {
    char fresh[PATH_MAX];

    if (snprintf(fresh, sizeof fresh, "%s.new", path) >= (int)sizeof fresh)
        return -ENAMETOOLONG;
    FILE *file = fopen(fresh, "we");
    if (!file)
        return -errno;
    errno = 0;
    int error = write_image(image, format, file);
    bool failed = ferror(file);
    failed |= fclose(file) != 0;
    if (!error && failed)
        error = errno ? -errno : -EIO;
    if (!error && rename(fresh, path))
        error = -errno;
    if (error)
        unlink(fresh);
    return error;
}
