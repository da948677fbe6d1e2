/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Converts pictures from one layout to another. */
#ifndef DDXVIDEO_PICTURE_CONVERT_H
#define DDXVIDEO_PICTURE_CONVERT_H

#include <ddxvideo.h>
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

/* Converts pictures of any layout to 4:2:0, for encoders and screens. */
struct as_420 {
    /* private: */
    struct ddxvideo_geometry from; /* geometry of the converter's input */
    struct picture_converter *converter;
    struct ddxvideo_picture picture; /* the last result */
    unsigned char *memory;           /* its planes */
};

/*
 * The geometry after conversion to 4:2:0: unchanged if it is 4:2:0 already, otherwise cut to even sides. A width or
 * height of 0: it is too small.
 */
struct ddxvideo_geometry as_420_geometry(const struct ddxvideo_geometry *from);

/*
 * *result becomes the picture itself, if it is 4:2:0 already, or a copy, which is valid until the next call. 0,
 * -ENOMEM, or -ERANGE: the picture is too small.
 */
int as_420(struct as_420 *as, const struct ddxvideo_picture *picture, const struct ddxvideo_picture **result);

/* Text for an error of as_420() or ddxvideo_view_any(). */
const char *as_420_error(int error);

void as_420_close(struct as_420 *as);

#endif
