/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The luminance of pictures of each layout, 8 bits a pixel. */
#ifndef DDXVIDEO_STEREO_LUMA_H
#define DDXVIDEO_STEREO_LUMA_H

#include <stdint.h>

#include "ddxvideo.h"

struct luma {
    const uint8_t *at;
    long stride;
    uint8_t *made; /* for pictures without a luminance plane */
    size_t size;
};

/* The luminance of a picture, valid as long as the picture and until the next call. 0, -ENOMEM. */
int luma_of(struct luma *luma, const struct ddxvideo_picture *picture);
void luma_free(struct luma *luma);

/* A table from samples to full range. */
void luma_levels(int range, uint8_t level[256]);

#endif
