/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Paints pictures of the store onto a canvas. */
#ifndef DDXVIDEO_PAINT_H
#define DDXVIDEO_PAINT_H

#include <ddxvideo.h>

#include "layout.h"
#include "surface.h"

struct SwsContext;

/* State from picture to picture: the caller's, all 0 at first, until paint_close(). */
struct painter {
    struct SwsContext *scaler[DDX_VIDEO_FIELDS];
    uint32_t *rows; /* the target of a scaler that would write beyond the canvas */
    size_t size;    /* bytes of it */
};

/*
 * Fill the canvas: each place of the layout with its field, the rest with `background`. Pixels are not changed where
 * the layout is exact, or where a place is as large as the field; elsewhere they are scaled smoothly. The range is the
 * picture's (limited if unknown), the matrix that of ITU-R BT.601. Fields outside of the canvas cost nothing. 0 or
 * -ENOMEM.
 */
int paint_fields(struct painter *painter, const struct canvas *canvas, const struct ddxvideo_picture *picture,
                 const struct layout *layout, uint32_t background);
void paint_close(struct painter *painter);

/* One pixel of a picture: its samples, and its colour on the screen. Coordinates within the field. */
struct paint_pixel {
    int y, u, v;
    int red, green, blue;
};
struct paint_pixel paint_look(const struct ddxvideo_picture *picture, int field, int column, int row);

/* The part of a rectangle that lies on the canvas; the result may be empty (width or height 0). */
struct canvas paint_part(const struct canvas *canvas, int x, int y, int width, int height);

/* Fill the rectangle with one colour. */
void paint_all(const struct canvas *canvas, uint32_t colour);

/* Half as bright and without colour, for a picture that is not current. */
void paint_grey(const struct canvas *canvas);

#endif
