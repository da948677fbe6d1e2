/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Converts pictures from one layout to another. */
#ifndef DDXVIDEO_PICTURE_CONVERT_H
#define DDXVIDEO_PICTURE_CONVERT_H

#include <stdbool.h>

#include "ddxvideo.h"

#define PICTURE_READ_BEYOND 64 /* readable bytes that a converter needs after the last byte of its source's planes */

/* Format of a source's samples. */
struct picture_kind {
    int bits;               /* of a sample; above 8 they are 16-bit little endian */
    int chroma_x, chroma_y; /* log2 of the subsampling; -1: no chroma, grey or RGB */
    bool rgb;               /* red, green and blue in plane 0 */
    bool full;              /* black is 0 and white is 255, not 16 and 235 */
    bool centred;           /* chroma samples sit between luma columns, not on the left one */
};

/* Format of a picture in the store. */
struct picture_kind picture_kind_of(const struct ddxvideo_geometry *geometry);

struct picture_converter;

/*
 * A converter from pictures of this kind to pictures of this geometry. A source may be larger than the result: then its
 * right and lower edges are cut off. NULL: no memory, or the conversion is not supported (RGB to grey). The caller
 * frees it with picture_converter_free().
 */
struct picture_converter *picture_converter_new(const struct picture_kind *from, const struct ddxvideo_geometry *to);
void picture_converter_free(struct picture_converter *converter); /* NULL is allowed */

/* Convert a picture. Strides are in bytes. False if it failed; the result is undefined then. */
bool picture_convert(struct picture_converter *converter, const unsigned char *const from[3], const int from_stride[3],
                     unsigned char *const to[3], const int to_stride[3]);

#endif
