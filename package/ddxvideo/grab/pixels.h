/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The camera's pixel formats that we take, and how they lie in its buffers. */
#ifndef DDXVIDEO_PIXELS_H
#define DDXVIDEO_PIXELS_H

#include <libavutil/pixfmt.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum pixels_coding {
    PIXELS_NONE,
    PIXELS_YU12,
    PIXELS_NV12,
    PIXELS_YUYV,
    PIXELS_UYVY,
    PIXELS_MJPEG,
    PIXELS_JPEG,
    PIXELS_GREY,
};

/* How two fields lie in a buffer. */
enum pixels_order {
    PIXELS_PROGRESSIVE, /* no fields */
    PIXELS_INTERLEAVED, /* row by row, the top field first */
    PIXELS_TOP_BOTTOM,  /* the whole top field, then the bottom field */
    PIXELS_BOTTOM_TOP
};

/* What one buffer of the camera holds. */
struct pixels {
    enum pixels_coding coding;
    int width, height;
    int stride; /* of the first plane, bytes from row to row; 0 where it has no meaning (MJPEG) */
    enum pixels_order order;
};

struct pixels_format {
    enum pixels_coding coding;
    const char *name; /* as -format takes it */
    enum AVPixelFormat libav;
    bool compressed;
    uint8_t planes;
    uint8_t row_bytes;       /* of the first plane, per pixel */
    uint8_t other_divisor;   /* the other planes' stride is the first one's divided by this */
    uint8_t chroma_row_step; /* rows of luma for each row of the other planes */
};

const struct pixels_format *pixels_find(enum pixels_coding coding); /* or NULL */
const struct pixels_format *pixels_named(const char *name);         /* in any case; or NULL */

/* Where the planes begin, and their strides; returns the bytes that a whole picture has (0: compressed). */
size_t pixels_planes(const struct pixels *pixels, size_t offset[3], int stride[3]);

#endif
