/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "pixels.h"

#include <ddxvideo.h>
#include <strings.h>

#define NO_DEEP AV_PIX_FMT_NONE
#define UNIQUE (-1) /* no layout has the same samples */

static const struct pixels_format pixels_formats[] = {
    {PIXELS_YU12, "YU12", AV_PIX_FMT_YUV420P, false, 3, 1, 2, 2, UNPACK_NOTHING, NO_DEEP, DDX_VIDEO_420},
    {PIXELS_NV12, "NV12", AV_PIX_FMT_NV12, false, 2, 1, 1, 2, UNPACK_NOTHING, NO_DEEP, UNIQUE},
    {PIXELS_YUYV, "YUYV", AV_PIX_FMT_YUYV422, false, 1, 2, 1, 1, UNPACK_NOTHING, NO_DEEP, DDX_VIDEO_YUV422P},
    {PIXELS_UYVY, "UYVY", AV_PIX_FMT_UYVY422, false, 1, 2, 1, 1, UNPACK_NOTHING, NO_DEEP, DDX_VIDEO_YUV422P},
    {PIXELS_MJPEG, "MJPEG", AV_PIX_FMT_NONE, true, 0, 0, 1, 1, UNPACK_NOTHING, NO_DEEP, UNIQUE},
    {PIXELS_JPEG, "JPEG", AV_PIX_FMT_NONE, true, 0, 0, 1, 1, UNPACK_NOTHING, NO_DEEP, UNIQUE},
    {PIXELS_GREY, "GREY", AV_PIX_FMT_GRAY8, false, 1, 1, 1, 1, UNPACK_NOTHING, NO_DEEP, DDX_VIDEO_GREY8},
    {PIXELS_Y16, "Y16", AV_PIX_FMT_GRAY8, false, 1, 2, 1, 1, UNPACK_16_LE, AV_PIX_FMT_GRAY16LE, DDX_VIDEO_GREY16},
    {PIXELS_GREY16, "GREY16", AV_PIX_FMT_GRAY8, false, 1, 2, 1, 1, UNPACK_16, AV_PIX_FMT_GRAY16BE, DDX_VIDEO_GREY16},
    {PIXELS_YUV411, "YUV411", AV_PIX_FMT_YUV411P, false, 1, 0, 1, 1, UNPACK_411, NO_DEEP, UNIQUE},
    {PIXELS_YUV444, "YUV444", AV_PIX_FMT_YUV444P, false, 1, 3, 1, 1, UNPACK_444, NO_DEEP, DDX_VIDEO_YUV444P},
    {PIXELS_RGB24, "RGB24", AV_PIX_FMT_RGB24, false, 1, 3, 1, 1, UNPACK_NOTHING, NO_DEEP, DDX_VIDEO_RGB24},
    {PIXELS_RGB48, "RGB48", AV_PIX_FMT_RGB24, false, 1, 6, 1, 1, UNPACK_16, NO_DEEP, UNIQUE},
    {PIXELS_RGGB, "RGGB", AV_PIX_FMT_BAYER_RGGB8, false, 1, 1, 1, 1, UNPACK_NOTHING, NO_DEEP, UNIQUE},
    {PIXELS_GBRG, "GBRG", AV_PIX_FMT_BAYER_GBRG8, false, 1, 1, 1, 1, UNPACK_NOTHING, NO_DEEP, UNIQUE},
    {PIXELS_GRBG, "GRBG", AV_PIX_FMT_BAYER_GRBG8, false, 1, 1, 1, 1, UNPACK_NOTHING, NO_DEEP, UNIQUE},
    {PIXELS_BGGR, "BGGR", AV_PIX_FMT_BAYER_BGGR8, false, 1, 1, 1, 1, UNPACK_NOTHING, NO_DEEP, UNIQUE},
    {PIXELS_RGGB16, "RGGB16", AV_PIX_FMT_BAYER_RGGB8, false, 1, 2, 1, 1, UNPACK_16, NO_DEEP, UNIQUE},
    {PIXELS_GBRG16, "GBRG16", AV_PIX_FMT_BAYER_GBRG8, false, 1, 2, 1, 1, UNPACK_16, NO_DEEP, UNIQUE},
    {PIXELS_GRBG16, "GRBG16", AV_PIX_FMT_BAYER_GRBG8, false, 1, 2, 1, 1, UNPACK_16, NO_DEEP, UNIQUE},
    {PIXELS_BGGR16, "BGGR16", AV_PIX_FMT_BAYER_BGGR8, false, 1, 2, 1, 1, UNPACK_16, NO_DEEP, UNIQUE},
    {PIXELS_NONE, NULL, AV_PIX_FMT_NONE, false, 0, 0, 1, 1, UNPACK_NOTHING, NO_DEEP, UNIQUE},
};

const struct pixels_format *pixels_find(enum pixels_coding coding) {
    for (const struct pixels_format *format = pixels_formats; format->name; format++)
        if (format->coding == coding)
            return format;
    return NULL;
}

const struct pixels_format *pixels_named(const char *name) {
    for (const struct pixels_format *format = pixels_formats; format->name; format++)
        if (!strcasecmp(format->name, name))
            return format;
    return NULL;
}

size_t pixels_planes(const struct pixels *pixels, size_t offset[3], int stride[3]) {
    const struct pixels_format *format = pixels_find(pixels->coding);
    size_t end = 0;

    for (int i = 0; i < 3; i++) {
        bool there = format && !format->compressed && i < format->planes;
        int rows = !there ? 0 : i ? pixels->height / format->chroma_row_step : pixels->height;

        stride[i] = !there ? 0 : i ? pixels->stride / format->other_divisor : pixels->stride;
        offset[i] = end;
        end += (size_t)stride[i] * (size_t)rows;
    }
    return end;
}
