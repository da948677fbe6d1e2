/* SPDX-License-Identifier: GPL-2.0-or-later */
/* From the camera's buffer into the planes of a loaned frame, in one pass: pixel format, size and fields at once. */
#ifndef DDXVIDEO_CONVERT_H
#define DDXVIDEO_CONVERT_H

#include <ddxvideo.h>
#include <stddef.h>

#include "jpeg.h"
#include "pixels.h"

struct converter {
    struct pixels from;
    int width, height; /* of the result */
    bool stack;        /* the two fields one above the other instead of row by row */
    /* private: */
    const struct pixels_format *format;
    unsigned parts;         /* 2: field by field, so that fields never mix */
    struct SwsContext *sws; /* of one part; NULL where rows are copied */
    struct jpeg *jpeg;      /* for compressed pictures */
    unsigned char *rearranged; /* by unpack_run(), where that is needed */
};

/*
 * Get ready. Fields that lie in a buffer one after the other come out row by row, or stacked if told so. 0; -EINVAL: no
 * such format, or heights that two fields do not divide; -ENOMEM.
 */
int converter_open(struct converter *converter, const struct pixels *from, int width, int height, bool stack);

/*
 * Convert the `used` bytes at `data` into the three planes. 0, -EBADMSG: they hold no whole picture, -ENOMEM.
 */
int converter_run(struct converter *converter, const void *data, size_t used, unsigned char *const plane[3],
                  const int stride[3]);

void converter_close(struct converter *converter);

#endif
