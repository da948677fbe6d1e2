/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The newest pictures of several items, side by side in a grid. */
#ifndef DDXVIDEO_MONTAGE_H
#define DDXVIDEO_MONTAGE_H

#include "image.h"

#define MONTAGE_MAX 64     /* items */
#define MONTAGE_SIDE 16384 /* pixels */

struct montage_place {
    int x, y, width, height;
    int right; /* of the cell: where a caption ends at the latest */
    int scale; /* of its text */
};

/*
 * Where each of `count` pictures goes, in rows from the top left: cells as large as the largest picture, but smaller
 * where the whole would exceed MONTAGE_SIDE; each picture keeps its shape and sits in the middle of its cell, with room
 * for a line of text below it. Sizes of the whole in *width, *height.
 */
void montage_plan(const struct ddxvideo_geometry *pictures, unsigned count, struct montage_place *places, int *width,
                  int *height);

/* Write below the picture of a place what it is. 0 or -ENOMEM. */
int montage_caption(AVFrame *image, const struct montage_place *place, const char *text);

#endif
