/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The newest pictures of several items, side by side in a grid. */
#ifndef DDXVIDEO_MONTAGE_H
#define DDXVIDEO_MONTAGE_H

#include "image.h"

#define MONTAGE_MAX 64     /* items */
#define MONTAGE_SIDE 16384 /* pixels */

struct montage_place {
    int x, y, width, height;
    int right; /* of the cell: the limit of a caption */
    int scale; /* of its text */
};

/*
 * Place `count` pictures in rows from the top left. Cells are as large as the largest picture, or smaller if the whole
 * would exceed MONTAGE_SIDE. Each picture keeps its shape in the middle of its cell, with a line of text below it. The
 * size of the whole is in *width, *height.
 */
void montage_plan(const struct ddxvideo_geometry *pictures, unsigned count, struct montage_place *places, int *width,
                  int *height);

/* Write the caption below a picture. 0 or -ENOMEM. */
int montage_caption(AVFrame *image, const struct montage_place *place, const char *text);

#endif
