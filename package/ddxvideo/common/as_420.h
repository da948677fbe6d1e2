/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Converts pictures of any layout to 4:2:0, for encoders and screens. */
#ifndef DDXVIDEO_AS_420_H
#define DDXVIDEO_AS_420_H

#include <ddxvideo.h>

struct picture_converter;

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
