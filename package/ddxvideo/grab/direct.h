/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Conversions without libswscale to layouts other than 4:2:0: rows are copied, or their samples separated. */
#ifndef DDXVIDEO_DIRECT_H
#define DDXVIDEO_DIRECT_H

#include <libavutil/pixfmt.h>
#include <stdbool.h>

#include "video_layout.h"

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

#endif
