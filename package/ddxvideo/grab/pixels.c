/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "pixels.h"

#include <strings.h>

static const struct pixels_format pixels_formats[] = {
    {PIXELS_YU12, "YU12", AV_PIX_FMT_YUV420P, false, 3, 1, 2, 2},
    {PIXELS_NV12, "NV12", AV_PIX_FMT_NV12, false, 2, 1, 1, 2},
    {PIXELS_YUYV, "YUYV", AV_PIX_FMT_YUYV422, false, 1, 2, 1, 1},
    {PIXELS_UYVY, "UYVY", AV_PIX_FMT_UYVY422, false, 1, 2, 1, 1},
    {PIXELS_MJPEG, "MJPEG", AV_PIX_FMT_NONE, true, 0, 0, 1, 1},
    {PIXELS_JPEG, "JPEG", AV_PIX_FMT_NONE, true, 0, 0, 1, 1},
    {PIXELS_GREY, "GREY", AV_PIX_FMT_GRAY8, false, 1, 1, 1, 1},
    {PIXELS_NONE, NULL, AV_PIX_FMT_NONE, false, 0, 0, 1, 1},
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
