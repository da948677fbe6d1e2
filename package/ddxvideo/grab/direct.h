/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Pixels that need no libswscale to be in a layout other than 4:2:0: their rows are copied, or taken apart. */
#ifndef DDXVIDEO_DIRECT_H
#define DDXVIDEO_DIRECT_H

#include <libavutil/pixfmt.h>
#include <stdbool.h>

#include "video_layout.h"

/* What a row function has to know beside the row. */
struct direct {
    int width; /* pixels */
    int depth; /* of GRAY16BE: bits in use, 8 to 16 */
    bool full; /* the range of luma: black is 0 and white is 255, not 16 and 235 */
};

/* Take one row of each plane. Nothing beyond the row's end is written. */
typedef void direct_row(const struct direct *direct, const unsigned char *const from[3], unsigned char *const to[3]);

/*
 * The function that brings rows of this format into the layout, luma unchanged; NULL: there is none. Of 4:2:0 there is
 * only the one that copies luma: chroma has rows of its own.
 */
direct_row *direct_find(enum AVPixelFormat format, const struct video_layout *layout);

#endif
