/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Table of the picture layouts in the store. */
#ifndef DDXVIDEO_VIDEO_LAYOUT_H
#define DDXVIDEO_VIDEO_LAYOUT_H

#include <stdbool.h>
#include <stddef.h>

#include "ddxvideo.h"

struct video_layout {
    const char *name;       /* in options and messages */
    int format;             /* enum ddx_video_format; for 4:2:0 the first of the four */
    const char *sample;     /* C type of a sample in the item */
    int bytes;              /* of a sample */
    int samples;            /* of a pixel, in plane y */
    int chroma_x, chroma_y; /* log2 of the subsampling of u and v; -1: the layout has no such planes */
};

#define VIDEO_LAYOUT_NAMES "YUV420P, YUV422P, YUV444P, GREY8, GREY16 or RGB24" /* as options take them */

/* The layout of an enum ddx_video_format; NULL: there is no such format. */
const struct video_layout *video_layout_of(int format);

/* The layout of this name, in upper or lower case; NULL: there is no such layout. */
const struct video_layout *video_layout_named(const char *name);

static inline bool video_layout_is_420(int format) {
    return format >= DDX_VIDEO_420 && format <= DDX_VIDEO_420_PALDV;
}

/* Bytes of a row, and rows, of plane 0 to 2 of a picture; both 0 for a plane that the layout does not have. */
void video_layout_plane(const struct video_layout *layout, int width, int height, int plane, int *stride, int *rows);

/* Bytes of all planes of a picture of this (checked) geometry. */
size_t video_layout_bytes(const struct ddxvideo_geometry *geometry);

/* Set the planes, strides and rows of a picture to this memory, one plane after the other without padding. Its geometry
 * is set and checked; `memory` has video_layout_bytes() of it, and stays the caller's. */
void video_layout_place(struct ddxvideo_picture *picture, unsigned char *memory);

/* Copy a picture; `memory` as above. */
void video_layout_copy(struct ddxvideo_picture *to, const struct ddxvideo_picture *from, unsigned char *memory);

#endif
