/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The newest pictures of several items, side by side in a grid. */
#ifndef DDXVIDEO_MONTAGE_H
#define DDXVIDEO_MONTAGE_H

#include "image.h"

#define MONTAGE_MAX 64     /* items */
#define MONTAGE_SIDE 16384 /* pixels */

struct montage_place {
    int x, y, width, height;
};

/*
 * Where each of `count` pictures goes, in rows from the top left: cells as large as the largest picture, but smaller
 * where the whole would exceed MONTAGE_SIDE; each picture keeps its shape and sits in the middle of its cell. Sizes of
 * the whole in *width, *height.
 */
void montage_plan(const struct ddxvideo_geometry *pictures, unsigned count, struct montage_place *places, int *width,
                  int *height);

#endif
