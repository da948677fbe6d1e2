/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "direct.h"

#include <string.h>

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
