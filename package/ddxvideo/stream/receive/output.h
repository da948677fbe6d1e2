/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Writes decoded pictures into a video item of this machine's store. */
#ifndef DDXVIDEO_DECODE_OUTPUT_H
#define DDXVIDEO_DECODE_OUTPUT_H

#include <ddxvideo.h>
#include <libavutil/frame.h>
#include <stdbool.h>

struct output_item {
    const char *name; /* NULL: none */
    DDX_STORE_ITEM *item;
    struct ddxvideo_geometry geometry; /* of the item */
    int64_t create;                    /* earliest time of the next attempt */
    int error;                         /* why the last attempt failed */
};

/* A decoded picture as it is in a video item: geometry and planes, which stay the frame's. */
struct ddxvideo_picture output_picture(const AVFrame *frame, AVRational rate);

/* Whether an error means that the store runs, but refuses such pictures, at least for now. */
bool output_is_refused(int error);

/* Write the picture. 0, or -errno; in each case the next picture can be tried. */
int output_write(struct output_item *output, DDX_STORE_ID *id, const AVFrame *picture, AVRational rate,
                 const struct ddxvideo_stamp *stamp);

void output_close(struct output_item *output);

#endif
