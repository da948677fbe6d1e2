/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Places the fields of a picture of the store on a canvas, and paints them there. */
#ifndef DDXVIDEO_PAINT_H
#define DDXVIDEO_PAINT_H

#include <ddxvideo.h>
#include <stdbool.h>

#include "surface.h"

/* ---- Places ---- */

#define LAYOUT_ALL (-1) /* in place of a field's number: all fields */

enum layout_fit {
    LAYOUT_SHAPE, /* as large as possible in the picture's shape */
    LAYOUT_FILL,  /* the whole canvas; the shape may change */
    LAYOUT_PIXELS /* a pixel of the canvas for each of the field */
};

/* Pixels of the canvas; a zoomed place reaches beyond it. */
struct layout_place {
    int field; /* from 0 */
    int x, y, width, height;
};

struct layout {
    int width, height; /* of a field, pixels */
    bool exact;        /* show its pixels unchanged, not scaled smoothly */
    int count;
    struct layout_place place[DDX_VIDEO_FIELDS];
};

/* The visible part: x' = x * zoom + this x. 1, 0, 0 shows everything. */
struct layout_view {
    double zoom, x, y;
};

/* A field's size in square pixels, by its pixel aspect. */
void layout_square(const struct ddxvideo_geometry *geometry, double *width, double *height);

/*
 * Places fields side by side where that uses the canvas better, otherwise stacked. If the picture has no field of this
 * number, its last one is shown. width, height: of the canvas, at least 1.
 */
void layout_fields(struct layout *layout, const struct ddxvideo_geometry *geometry, int field, enum layout_fit fit,
                   int width, int height);

/* Move and enlarge all places by the view. Places are exact where the view enlarges. */
void layout_zoom(struct layout *layout, const struct layout_view *view);

/*
 * Zoom by `factor` around a point of the canvas. The zoom is at least 1, and a pixel at most LAYOUT_LARGEST.
 * `layout` is the layout before layout_zoom().
 */
#define LAYOUT_LARGEST 64
void layout_zoom_at(const struct layout *layout, struct layout_view *view, double factor, int x, int y);

/* The field at a point of the canvas, and the pixel in it. False if there is no field. */
bool layout_at(const struct layout *layout, int x, int y, int *field, int *column, int *row);

/* ---- Colours ---- */

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
