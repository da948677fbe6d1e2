/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The requested settings of a camera. */
#ifndef DDXVIDEO_SETUP_WISH_H
#define DDXVIDEO_SETUP_WISH_H

#include <dc1394/dc1394.h>
#include <ddxvideo.h>

#include "video_layout.h"

struct setup_wish {
    const struct video_layout *layout; /* of the result */
    dc1394video_mode_t mode; /* 0: the best for the size, or the camera's current one */
    int width, height;       /* of the result; 0: the camera's current size */
    dc1394color_coding_t coding; /* of FORMAT7; 0: the camera's current one */
    int left, top, roi_width, roi_height; /* of FORMAT7; 0: the whole sensor */
    double rate;                          /* frames per second; 0: the fastest */
    dc1394color_filter_t bayer;           /* 0: the camera's */
};

#endif
