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
    PIXELS_Y16, /* grey, 16 bits, the lower byte first */
    PIXELS_RGB24,
    /* of IIDC cameras: */
    PIXELS_GREY16, /* samples of 16 bits: the upper byte first, `depth` bits in use */
    PIXELS_YUV411, /* U Y Y V Y Y */
    PIXELS_YUV444, /* U Y V */
    PIXELS_RGB48, /* samples as of GREY16 */
    PIXELS_RGGB,  /* raw sensor: its first two rows begin with R G and G B */
    PIXELS_GBRG,
    PIXELS_GRBG,
    PIXELS_BGGR,
    PIXELS_RGGB16, /* the same, samples as of GREY16 */
    PIXELS_GBRG16,
    PIXELS_GRBG16,
    PIXELS_BGGR16,
};

/* What has to be done before libswscale can read it. */
enum pixels_unpack { UNPACK_NOTHING, UNPACK_16, UNPACK_16_LE, UNPACK_411, UNPACK_444 };

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
    int depth; /* of samples of 16 bits: how many are in use, 8 to 16 */
};

struct pixels_format {
    enum pixels_coding coding;
    const char *name; /* as -format takes it */
    enum AVPixelFormat libav; /* after `unpack` */
    bool compressed;
    uint8_t planes;
    uint8_t row_bytes;       /* of the first plane, per pixel */
    uint8_t other_divisor;   /* the other planes' stride is the first one's divided by this */
    uint8_t chroma_row_step; /* rows of luma for each row of the other planes */
    enum pixels_unpack unpack;
    enum AVPixelFormat deep; /* for a layout of 16 bits, without `unpack`; AV_PIX_FMT_NONE: the camera has 8 bits */
    int layout; /* enum ddx_video_format that has the same samples; -1: there is none */
};

const struct pixels_format *pixels_find(enum pixels_coding coding); /* or NULL */
const struct pixels_format *pixels_named(const char *name);         /* in any case; or NULL */

/* Where the planes begin, and their strides; returns the bytes that a whole picture has (0: compressed). */
size_t pixels_planes(const struct pixels *pixels, size_t offset[3], int stride[3]);

#endif
