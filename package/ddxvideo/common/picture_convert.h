/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Pictures of one layout to another one. */
#ifndef DDXVIDEO_PICTURE_CONVERT_H
#define DDXVIDEO_PICTURE_CONVERT_H

#include <stdbool.h>

#include "ddxvideo.h"

#define PICTURE_READ_BEYOND 64 /* readable bytes that a converter needs after the last byte of its source's planes */

/* What the samples of a source mean. */
struct picture_kind {
    int bits;               /* of a sample; above 8 they are 16-bit little endian */
    int chroma_x, chroma_y; /* log2 of the subsampling; -1: no chroma, grey or RGB */
    bool rgb;               /* red, green and blue in plane 0 */
    bool full;              /* black is 0 and white is 255, not 16 and 235 */
    bool centred;           /* chroma samples sit amid luma columns, not on the left one */
};

/* That of a picture in the store. */
struct picture_kind picture_kind_of(const struct ddxvideo_geometry *geometry);

struct picture_converter;

/*
 * From pictures of a kind, of the result's size or a larger one (what is beyond the result's right and lower edges is
 * left out), to pictures of this geometry. NULL: no memory, or there is no such conversion (RGB to grey). The result is
 * the caller's, to picture_converter_free().
 */
struct picture_converter *picture_converter_new(const struct picture_kind *from, const struct ddxvideo_geometry *to);
void picture_converter_free(struct picture_converter *converter); /* NULL is allowed */

/* Convert one. Strides are in bytes. False if it failed; the result is undefined then. */
bool picture_convert(struct picture_converter *converter, const unsigned char *const from[3], const int from_stride[3],
                     unsigned char *const to[3], const int to_stride[3]);

#endif
