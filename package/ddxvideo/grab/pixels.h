/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The supported pixel formats of cameras, their order in a camera's buffers, and the conversions that need no
 * libswscale, or that it needs before it can read the samples.
 */
#ifndef DDXVIDEO_PIXELS_H
#define DDXVIDEO_PIXELS_H

#include <libavutil/pixfmt.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "video_layout.h"

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
    PIXELS_RGB48,  /* samples as of GREY16 */
    PIXELS_RGGB,   /* raw sensor: its first two rows begin with R G and G B */
    PIXELS_GBRG,
    PIXELS_GRBG,
    PIXELS_BGGR,
    PIXELS_RGGB16, /* the same, samples as of GREY16 */
    PIXELS_GBRG16,
    PIXELS_GRBG16,
    PIXELS_BGGR16,
};

/* Rearrangement before libswscale can read the samples. */
enum pixels_unpack { UNPACK_NOTHING, UNPACK_16, UNPACK_16_LE, UNPACK_411, UNPACK_444 };

/* Order of two fields in a buffer. */
enum pixels_order {
    PIXELS_PROGRESSIVE, /* no fields */
    PIXELS_INTERLEAVED, /* row by row, the top field first */
    PIXELS_TOP_BOTTOM,  /* the whole top field, then the bottom field */
    PIXELS_BOTTOM_TOP
};

/* Contents of a camera's buffer. */
struct pixels {
    enum pixels_coding coding;
    int width, height;
    int stride; /* of the first plane, bytes from row to row; 0 for MJPEG */
    enum pixels_order order;
    int depth; /* bits in use of 16-bit samples, 8 to 16 */
};

struct pixels_format {
    enum pixels_coding coding;
    const char *name;         /* in -format */
    enum AVPixelFormat libav; /* after `unpack` */
    bool compressed;
    uint8_t planes;
    uint8_t row_bytes;       /* of the first plane, per pixel */
    uint8_t other_divisor;   /* the other planes' stride is the first one's divided by this */
    uint8_t chroma_row_step; /* rows of luma for each row of the other planes */
    enum pixels_unpack unpack;
    enum AVPixelFormat deep; /* for a layout of 16 bits, without `unpack`; AV_PIX_FMT_NONE: the camera has 8 bits */
    int layout;              /* enum ddx_video_format that has the same samples; -1: there is none */
};

const struct pixels_format *pixels_find(enum pixels_coding coding); /* or NULL */
const struct pixels_format *pixels_named(const char *name);         /* in any case; or NULL */

/* Begins and strides of the planes. Returns the bytes of a whole picture (0: compressed). */
size_t pixels_planes(const struct pixels *pixels, size_t offset[3], int stride[3]);

/* ---- Conversions without libswscale to layouts other than 4:2:0: rows are copied, or their samples separated ---- */

/* Parameters of a row function. */
struct direct {
    int width; /* pixels */
    int depth; /* of GRAY16BE: bits in use, 8 to 16 */
    bool full; /* the range of luma: black is 0 and white is 255, not 16 and 235 */
};

/* Convert one row of each plane. Writes nothing beyond the end of the row. */
typedef void direct_row(const struct direct *direct, const unsigned char *const from[3], unsigned char *const to[3]);

/*
 * The function that converts rows of this format to the layout, with luma unchanged; NULL: there is none. For 4:2:0
 * there is only a copy of luma, since chroma has separate rows.
 */
direct_row *direct_find(enum AVPixelFormat format, const struct video_layout *layout);

/* ---- Pixels whose order libswscale cannot read, as IIDC cameras send them ---- */

/* Bytes of a whole rearranged picture. */
size_t unpack_size(const struct pixels *pixels);

/* Rearrange a whole picture into `to`; sets its planes and strides. */
void unpack_run(const struct pixels *pixels, const unsigned char *from, unsigned char *to, unsigned char *plane[3],
                int stride[3]);

#endif
