/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Sets the camera up: mode, coding, part of the picture, rate. */
#ifndef DDXVIDEO_SETUP_H
#define DDXVIDEO_SETUP_H

#include <dc1394/dc1394.h>
#include <ddxvideo.h>

#include "pixels.h"
#include "video_layout.h"

/* The requested settings of a camera. */
struct setup_wish {
    const struct video_layout *layout;    /* of the result */
    dc1394video_mode_t mode;              /* 0: the best for the size, or the camera's current one */
    int width, height;                    /* of the result; 0: the camera's current size */
    dc1394color_coding_t coding;          /* of FORMAT7; 0: the camera's current one */
    int left, top, roi_width, roi_height; /* of FORMAT7; 0: the whole sensor */
    double rate;                          /* frames per second; 0: the fastest */
    dc1394color_filter_t bayer;           /* 0: the camera's */
};

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
