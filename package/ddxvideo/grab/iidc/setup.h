/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Sets the camera up: mode, coding, part of the picture, rate. */
#ifndef DDXVIDEO_SETUP_H
#define DDXVIDEO_SETUP_H

#include "pixels.h"
#include "setup_wish.h"

struct setup {
    struct pixels pixels;
    struct ddxvideo_geometry geometry;
    bool eight_bits; /* each sample */
};

/*
 * Stop the camera and set it up. 0; -EINVAL: it cannot do this; -EIO: it does not answer as it should; with the reason
 * in one line at `why`.
 */
int setup_camera(dc1394camera_t *device, const struct setup_wish *wish, struct setup *setup, char *why, size_t size);

#endif
