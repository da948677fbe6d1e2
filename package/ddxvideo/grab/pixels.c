/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "pixels.h"

#include <ddxvideo.h>
#include <string.h>
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

#define GREY 128 /* chroma without a colour */

typedef const unsigned char *const *rows_in;
typedef unsigned char *const *rows_out;

/* ---- Copies ---- */

static void copy_luma(const struct direct *direct, rows_in from, rows_out to) {
    memcpy(to[0], from[0], (size_t)direct->width);
}

static void copy_16(const struct direct *direct, rows_in from, rows_out to) {
    memcpy(to[0], from[0], (size_t)direct->width * 2);
}

static void copy_rgb(const struct direct *direct, rows_in from, rows_out to) {
    memcpy(to[0], from[0], (size_t)direct->width * 3);
}

static void copy_422(const struct direct *direct, rows_in from, rows_out to) {
    copy_luma(direct, from, to);
    for (int i = 1; i < 3; i++)
        memcpy(to[i], from[i], (size_t)direct->width / 2);
}

static void copy_444(const struct direct *direct, rows_in from, rows_out to) {
    for (int i = 0; i < 3; i++)
        memcpy(to[i], from[i], (size_t)direct->width);
}

/* ---- Packed 4:2:2, separated ---- */

static void split(int pairs, const unsigned char *restrict from, unsigned char *restrict y, unsigned char *restrict u,
                  unsigned char *restrict v, int luma) {
    int chroma = 1 - luma; /* the first byte of its kind in four */

    for (int i = 0; i < pairs; i++) {
        y[2 * i] = from[4 * i + luma];
        y[2 * i + 1] = from[4 * i + luma + 2];
        u[i] = from[4 * i + chroma];
        v[i] = from[4 * i + chroma + 2];
    }
}

static void split_yuyv(const struct direct *direct, rows_in from, rows_out to) {
    split(direct->width / 2, from[0], to[0], to[1], to[2], 0);
}

static void split_uyvy(const struct direct *direct, rows_in from, rows_out to) {
    split(direct->width / 2, from[0], to[0], to[1], to[2], 1);
}

/* ---- Luma of eight bits, `step` bytes from pixel to pixel ---- */

static void pick(int width, const unsigned char *restrict from, int step, unsigned char *restrict to) {
    for (int x = 0; x < width; x++)
        to[x] = from[step * x];
}

static void widen(int width, const unsigned char *restrict from, int step, unsigned char *restrict to) {
    for (int x = 0; x < width; x++) {
        to[2 * x] = 0;
        to[2 * x + 1] = from[step * x];
    }
}

static void yuyv_to_grey(const struct direct *direct, rows_in from, rows_out to) {
    pick(direct->width, from[0], 2, to[0]);
}

static void uyvy_to_grey(const struct direct *direct, rows_in from, rows_out to) {
    pick(direct->width, from[0] + 1, 2, to[0]);
}

static void luma_to_16(const struct direct *direct, rows_in from, rows_out to) {
    widen(direct->width, from[0], 1, to[0]);
}

static void yuyv_to_16(const struct direct *direct, rows_in from, rows_out to) {
    widen(direct->width, from[0], 2, to[0]);
}

static void uyvy_to_16(const struct direct *direct, rows_in from, rows_out to) {
    widen(direct->width, from[0] + 1, 2, to[0]);
}

/* ---- Grey ---- */

/* The upper byte first, `depth` bits in use; values with more bits are clipped to the brightest one. */
static void deep_to_16(const struct direct *direct, rows_in from, rows_out to) {
    int depth = direct->depth;
    unsigned most = (1U << depth) - 1;

    for (int x = 0; x < direct->width; x++) {
        unsigned value = (unsigned)from[0][2 * x] << 8 | from[0][2 * x + 1];

        value = (value < most ? value : most) << (16 - depth);
        to[0][2 * x] = (unsigned char)value;
        to[0][2 * x + 1] = (unsigned char)(value >> 8);
    }
}

static void grey_to_422(const struct direct *direct, rows_in from, rows_out to) {
    copy_luma(direct, from, to);
    for (int i = 1; i < 3; i++)
        memset(to[i], GREY, (size_t)direct->width / 2);
}

static void grey_to_444(const struct direct *direct, rows_in from, rows_out to) {
    copy_luma(direct, from, to);
    for (int i = 1; i < 3; i++)
        memset(to[i], GREY, (size_t)direct->width);
}

/* Black is 0 in RGB, and white 255. */
static void grey_to_rgb(const struct direct *direct, rows_in from, rows_out to) {
    for (int x = 0; x < direct->width; x++) {
        int value = from[0][x];

        if (!direct->full)
            value = ((value - 16) * 255 + 109) / 219;
        memset(to[0] + 3 * x, value < 0 ? 0 : value > 255 ? 255 : value, 3);
    }
}

static bool has_luma_plane(enum AVPixelFormat format) {
    static const enum AVPixelFormat formats[] = {AV_PIX_FMT_GRAY8,   AV_PIX_FMT_YUV420P, AV_PIX_FMT_NV12,
                                                 AV_PIX_FMT_YUV422P, AV_PIX_FMT_YUV444P, AV_PIX_FMT_YUV440P,
                                                 AV_PIX_FMT_YUV411P};

    for (unsigned i = 0; i < sizeof formats / sizeof *formats; i++)
        if (formats[i] == format)
            return true;
    return false;
}

direct_row *direct_find(enum AVPixelFormat format, const struct video_layout *layout) {
    static const struct {
        int layout;
        enum AVPixelFormat format;
        direct_row *row;
    } table[] = {
        {DDX_VIDEO_420, AV_PIX_FMT_GRAY8, copy_luma},        {DDX_VIDEO_YUV422P, AV_PIX_FMT_YUYV422, split_yuyv},
        {DDX_VIDEO_YUV422P, AV_PIX_FMT_UYVY422, split_uyvy}, {DDX_VIDEO_YUV422P, AV_PIX_FMT_YUV422P, copy_422},
        {DDX_VIDEO_YUV422P, AV_PIX_FMT_GRAY8, grey_to_422},  {DDX_VIDEO_YUV444P, AV_PIX_FMT_YUV444P, copy_444},
        {DDX_VIDEO_YUV444P, AV_PIX_FMT_GRAY8, grey_to_444},  {DDX_VIDEO_GREY8, AV_PIX_FMT_YUYV422, yuyv_to_grey},
        {DDX_VIDEO_GREY8, AV_PIX_FMT_UYVY422, uyvy_to_grey}, {DDX_VIDEO_GREY16, AV_PIX_FMT_YUYV422, yuyv_to_16},
        {DDX_VIDEO_GREY16, AV_PIX_FMT_UYVY422, uyvy_to_16},  {DDX_VIDEO_GREY16, AV_PIX_FMT_GRAY16LE, copy_16},
        {DDX_VIDEO_GREY16, AV_PIX_FMT_GRAY16BE, deep_to_16}, {DDX_VIDEO_RGB24, AV_PIX_FMT_RGB24, copy_rgb},
        {DDX_VIDEO_RGB24, AV_PIX_FMT_GRAY8, grey_to_rgb},
    };

    for (unsigned i = 0; i < sizeof table / sizeof *table; i++)
        if (table[i].layout == layout->format && table[i].format == format)
            return table[i].row;
    if (!has_luma_plane(format))
        return NULL;
    return layout->format == DDX_VIDEO_GREY8 ? copy_luma : layout->format == DDX_VIDEO_GREY16 ? luma_to_16 : NULL;
}

/* ---- Orders of pixels that libswscale cannot read ---- */

/* Bytes in a row of the resulting planes. */
static void set_strides(const struct pixels *pixels, int stride[3]) {
    stride[0] = pixels->width;
    stride[1] = stride[2] = 0;
    switch (pixels_find(pixels->coding)->unpack) {
    case UNPACK_16:
    case UNPACK_16_LE: stride[0] = pixels->stride / 2; break;
    case UNPACK_411: stride[1] = stride[2] = pixels->width / 4; break;
    case UNPACK_444: stride[1] = stride[2] = pixels->width; break;
    case UNPACK_NOTHING: break;
    }
}

size_t unpack_size(const struct pixels *pixels) {
    int stride[3];

    set_strides(pixels, stride);
    return (size_t)(stride[0] + stride[1] + stride[2]) * (size_t)pixels->height;
}

/* Takes the eight upper ones of `depth` bits; values with more bits are clipped to the brightest one. */
static void take_upper_bits(const unsigned char *from, unsigned char *to, int samples, int depth) {
    for (int i = 0; i < samples; i++) {
        int value = (from[2 * i] << 8 | from[2 * i + 1]) >> (depth - 8);

        to[i] = (unsigned char)(value < 255 ? value : 255);
    }
}

/* Takes the upper bytes, which come second. */
static void take_second_bytes(const unsigned char *from, unsigned char *to, int samples) {
    for (int i = 0; i < samples; i++)
        to[i] = from[2 * i + 1];
}

/* U Y Y V Y Y: four pixels that share their chroma. */
static void part_411(const unsigned char *from, unsigned char *const to[3], int width) {
    for (int i = 0; i < width / 4; i++, from += 6) {
        to[1][i] = from[0];
        to[0][4 * i] = from[1];
        to[0][4 * i + 1] = from[2];
        to[2][i] = from[3];
        to[0][4 * i + 2] = from[4];
        to[0][4 * i + 3] = from[5];
    }
}

/* U Y V of each pixel. */
static void part_444(const unsigned char *from, unsigned char *const to[3], int width) {
    for (int i = 0; i < width; i++, from += 3) {
        to[1][i] = from[0];
        to[0][i] = from[1];
        to[2][i] = from[2];
    }
}

void unpack_run(const struct pixels *pixels, const unsigned char *from, unsigned char *to, unsigned char *plane[3],
                int stride[3]) {
    enum pixels_unpack unpack = pixels_find(pixels->coding)->unpack;

    set_strides(pixels, stride);
    for (int i = 0; i < 3; i++) {
        plane[i] = stride[i] ? to : NULL;
        to += (size_t)stride[i] * (size_t)pixels->height;
    }
    for (int row = 0; row < pixels->height; row++, from += pixels->stride) {
        unsigned char *at[3];

        for (int i = 0; i < 3; i++)
            at[i] = stride[i] ? plane[i] + (ptrdiff_t)row * stride[i] : NULL;
        if (unpack == UNPACK_16)
            take_upper_bits(from, at[0], pixels->stride / 2, pixels->depth);
        else if (unpack == UNPACK_16_LE)
            take_second_bytes(from, at[0], pixels->stride / 2);
        else if (unpack == UNPACK_411)
            part_411(from, at, pixels->width);
        else
            part_444(from, at, pixels->width);
    }
}
