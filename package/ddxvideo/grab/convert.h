/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Converts pixel format, size and fields in one pass, from the camera's buffer into the planes of a loaned frame. */
#ifndef DDXVIDEO_CONVERT_H
#define DDXVIDEO_CONVERT_H

#include <ddxvideo.h>
#include <libavutil/frame.h>
#include <stddef.h>

#include "pixels.h"

struct jpeg;

/* Planes that the converter owns. */
struct picture {
    unsigned char *plane[3];
    int stride[3];
};

struct converter {
    struct pixels from;
    int width, height; /* of the result */
    const struct video_layout *layout;
    bool stack; /* stack the two fields, instead of weaving them row by row */
    /* private: */
    const struct pixels_format *format;
    enum AVPixelFormat libav;    /* format of the camera's pictures, after unpack_run() and `bayer` */
    enum AVPixelFormat prepared; /* input format of the members below; AV_PIX_FMT_NONE: none */
    unsigned parts;              /* 2: field by field, so that fields never mix */
    struct direct direct;
    direct_row *before;       /* converts the camera's rows to the layout; NULL: libswscale does */
    direct_row *after;        /* converts scaled rows to the layout; NULL: scaled in place */
    struct SwsContext *sws;   /* for one part; NULL: `before` is enough */
    struct picture taken;     /* result of `before`, to be scaled */
    struct picture scaled;    /* libswscale may write beyond the end of rows: not into the store */
    struct jpeg *jpeg;        /* for compressed pictures */
    unsigned char *unpacked;  /* result of unpack_run(), if needed */
    struct SwsContext *bayer; /* raw sensor pictures to RGB; NULL: not raw */
    struct picture coloured;  /* result of `bayer` */
};

/*
 * Prepare for results of geometry `to`. `range` is that of the camera's luma. Fields that follow each other in a buffer
 * are woven row by row, or stacked with `stack`. 0; -EINVAL: no such format, or a height that two fields do not divide;
 * -ENOMEM.
 */
int converter_open(struct converter *converter, const struct pixels *from, int range,
                   const struct ddxvideo_geometry *to, bool stack);

/*
 * Convert the `used` bytes at `data` into the planes of the layout. 0; -EBADMSG: not a whole picture; -ENOMEM.
 */
int converter_run(struct converter *converter, const void *data, size_t used, unsigned char *const plane[3],
                  const int stride[3]);

void converter_close(struct converter *converter);

#endif
