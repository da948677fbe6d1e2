/* SPDX-License-Identifier: GPL-2.0-or-later */
/* From the camera's buffer into the planes of a loaned frame, in one pass: pixel format, size and fields at once. */
#ifndef DDXVIDEO_CONVERT_H
#define DDXVIDEO_CONVERT_H

#include <ddxvideo.h>
#include <stddef.h>

#include "direct.h"
#include "jpeg.h"
#include "pixels.h"

/* Planes of our own. */
struct picture {
    unsigned char *plane[3];
    int stride[3];
};

struct converter {
    struct pixels from;
    int width, height; /* of the result */
    const struct video_layout *layout;
    bool stack; /* the two fields one above the other instead of row by row */
    /* private: */
    const struct pixels_format *format;
    enum AVPixelFormat libav;    /* of the camera's pictures, after unpack_run() and `bayer` */
    enum AVPixelFormat prepared; /* the format that what follows is for; AV_PIX_FMT_NONE: for none */
    unsigned parts;              /* 2: field by field, so that fields never mix */
    struct direct direct;
    direct_row *before;       /* from the camera's rows to the layout's; NULL: libswscale does it */
    direct_row *after;        /* from the scaled picture's rows to the layout's; NULL: it has been scaled in place */
    struct SwsContext *sws;   /* of one part; NULL where `before` does all */
    struct picture taken;     /* by `before`, to be scaled */
    struct picture scaled;    /* libswscale may write rows beyond their end: not for the store */
    struct jpeg *jpeg;        /* for compressed pictures */
    unsigned char *unpacked;  /* by unpack_run(), where that is needed */
    struct SwsContext *bayer; /* raw pictures of a sensor to RGB; NULL: these are none */
    struct picture coloured;  /* by `bayer` */
};

/*
 * Get ready for pictures of this size and layout, `to`. `range` is that of the camera's luma. Fields that lie in a
 * buffer one after the other come out row by row, or stacked if told so. 0; -EINVAL: no such format, or heights that
 * two fields do not divide; -ENOMEM.
 */
int converter_open(struct converter *converter, const struct pixels *from, int range,
                   const struct ddxvideo_geometry *to, bool stack);

/*
 * Convert the `used` bytes at `data` into the planes that the layout has. 0, -EBADMSG: they hold no whole picture,
 * -ENOMEM.
 */
int converter_run(struct converter *converter, const void *data, size_t used, unsigned char *const plane[3],
                  const int stride[3]);

void converter_close(struct converter *converter);

#endif
