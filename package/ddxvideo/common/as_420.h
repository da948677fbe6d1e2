/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Pictures of any layout as 4:2:0, which is what encoders and screens take. */
#ifndef DDXVIDEO_AS_420_H
#define DDXVIDEO_AS_420_H

#include <ddxvideo.h>

struct picture_converter;

struct as_420 {
    /* private: */
    struct ddxvideo_geometry from;   /* of the pictures that the converter is for */
    struct picture_converter *converter;
    struct ddxvideo_picture picture; /* the newest one that was converted */
    unsigned char *memory;           /* its planes */
};

/*
 * What a picture of this geometry is like in 4:2:0: the same if it is 4:2:0 already, else cut to even sides. Width or
 * height 0: it is too small.
 */
struct ddxvideo_geometry as_420_geometry(const struct ddxvideo_geometry *from);

/*
 * *result becomes the picture itself, if it is 4:2:0 already, or a copy, which is valid until the next call. 0,
 * -ENOMEM, or -ERANGE: the picture is too small.
 */
int as_420(struct as_420 *as, const struct ddxvideo_picture *picture, const struct ddxvideo_picture **result);

/* For people: an error of as_420() or of ddxvideo_view_any(). */
const char *as_420_error(int error);

void as_420_close(struct as_420 *as);

#endif
