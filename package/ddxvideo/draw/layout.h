/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Where the fields of a picture go on a canvas. */
#ifndef DDXVIDEO_LAYOUT_H
#define DDXVIDEO_LAYOUT_H

#include <ddxvideo.h>
#include <stdbool.h>

#define LAYOUT_ALL (-1) /* in place of a field's number: all fields */

enum layout_fit {
    LAYOUT_SHAPE, /* as large as possible, in the picture's shape */
    LAYOUT_FILL,  /* the whole canvas, in whatever shape */
    LAYOUT_PIXELS /* a pixel of the canvas for each of the field */
};

/* Pixels of the canvas; zoomed ones reach beyond it. */
struct layout_place {
    int field; /* from 0 */
    int x, y, width, height;
};

struct layout {
    int width, height; /* of a field, pixels */
    bool exact;        /* its pixels are wanted as they are, not scaled smoothly */
    int count;
    struct layout_place place[DDX_VIDEO_FIELDS];
};

/* What the user sees of it: x' = x * zoom + this x. 1, 0, 0 is all. */
struct layout_view {
    double zoom, x, y;
};

/* A field's size in pixels that are square, as its pixel aspect says. */
void layout_square(const struct ddxvideo_geometry *geometry, double *width, double *height);

/*
 * Fields side by side where that uses the canvas better, else stacked. A field that the picture does not have is its
 * last one. width, height: of the canvas, at least 1.
 */
void layout_fields(struct layout *layout, const struct ddxvideo_geometry *geometry, int field, enum layout_fit fit,
                   int width, int height);

/* Move and enlarge all places as the view says: exact where it enlarges. */
void layout_zoom(struct layout *layout, const struct layout_view *view);

/*
 * Zoom by `factor` around a point of the canvas; no pixel gets larger than LAYOUT_LARGEST, and 1 is the least zoom.
 * `layout` is the one before layout_zoom().
 */
#define LAYOUT_LARGEST 64
void layout_zoom_at(const struct layout *layout, struct layout_view *view, double factor, int x, int y);

/* Where a point of the canvas is: field, and pixel in it. False if it is in none. */
bool layout_at(const struct layout *layout, int x, int y, int *field, int *column, int *row);

#endif
