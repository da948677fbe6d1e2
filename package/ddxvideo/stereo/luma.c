/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "luma.h"

#include <errno.h>
#include <stdlib.h>

static void make_row(int format, const uint8_t *from, int width, uint8_t *to) {
    for (int x = 0; x < width; x++)
        if (format == DDX_VIDEO_GREY16)
            to[x] = from[2 * x + 1];
        else
            to[x] = (uint8_t)((77 * from[3 * x] + 150 * from[3 * x + 1] + 29 * from[3 * x + 2] + 128) >> 8);
}

int luma_of(struct luma *luma, const struct ddxvideo_picture *picture) {
    const struct ddxvideo_geometry *geometry = &picture->geometry;
    size_t width = (size_t)geometry->width, size = width * (size_t)geometry->height;

    luma->at = picture->plane[0];
    luma->stride = picture->stride[0];
    if (geometry->format != DDX_VIDEO_GREY16 && geometry->format != DDX_VIDEO_RGB24)
        return 0;
    if (luma->size != size) {
        luma_free(luma);
        luma->made = malloc(size);
        if (!luma->made)
            return -ENOMEM;
        luma->size = size;
    }
    for (int y = 0; y < geometry->height; y++)
        make_row(geometry->format, picture->plane[0] + (long)y * picture->stride[0], geometry->width,
                 luma->made + (size_t)y * width);
    luma->at = luma->made;
    luma->stride = geometry->width;
    return 0;
}

void luma_free(struct luma *luma) {
    free(luma->made);
    luma->made = NULL;
    luma->size = 0;
}

void luma_levels(int range, uint8_t level[256]) {
    for (int i = 0; i < 256; i++) {
        int full = (i - 16) * 255 / 219;

        level[i] = (uint8_t)(range != DDX_VIDEO_RANGE_LIMITED ? i : full < 0 ? 0 : full > 255 ? 255 : full);
    }
}
