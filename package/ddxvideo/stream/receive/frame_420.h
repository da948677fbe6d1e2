/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Converts decoded pictures to 8-bit 4:2:0, for the item and the window. */
#ifndef DDXVIDEO_FRAME_420_H
#define DDXVIDEO_FRAME_420_H

#include <libavutil/frame.h>
#include <stdbool.h>

struct picture_converter;

struct frame_420 {
    /* private: */
    struct picture_converter *converter;
    int format, width, height; /* of the pictures that it is for */
    AVFrame *frame;            /* the newest one that was converted */
};

/* Whether pictures of this format are 8-bit 4:2:0 already, or can be converted. */
bool frame_420_is_possible(enum AVPixelFormat format);

/* Memory of a picture in this format, in whole pictures of 4:2:0. */
int frame_420_weight(enum AVPixelFormat format);

/* The picture itself, or a copy in 4:2:0, cut to even sides, until the next call. NULL: no memory. */
const AVFrame *frame_420(struct frame_420 *to, const AVFrame *picture);

void frame_420_close(struct frame_420 *to);

#endif
