/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Decoded pictures into a video item of this machine's store. */
#ifndef DDXVIDEO_DECODE_OUTPUT_H
#define DDXVIDEO_DECODE_OUTPUT_H

#include <ddxvideo.h>
#include <libavutil/frame.h>
#include <stdbool.h>

struct output_item {
    const char *name; /* NULL: none */
    DDX_STORE_ITEM *item;
    struct ddxvideo_geometry geometry; /* that the item was made for */
    int64_t create;                    /* not before this */
    int error;                         /* why the last attempt failed */
};

/* What the picture is like as a video item. */
struct ddxvideo_geometry output_geometry(const AVFrame *picture, AVRational rate);

/* Whether an error means that the store is there and does not take such pictures, at least not now. */
bool output_is_refused(int error);

/* Write the picture. 0, or -errno; whatever it is, the next picture may be tried. */
int output_write(struct output_item *output, DDX_STORE_ID *id, const AVFrame *picture, AVRational rate,
                 const struct ddxvideo_stamp *stamp);

void output_close(struct output_item *output);

#endif
