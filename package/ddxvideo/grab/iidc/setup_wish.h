/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What a camera is wanted to send. */
#ifndef DDXVIDEO_SETUP_WISH_H
#define DDXVIDEO_SETUP_WISH_H

#include <dc1394/dc1394.h>
#include <ddxvideo.h>

#include "video_layout.h"

struct setup_wish {
    const struct video_layout *layout; /* of the result */
    dc1394video_mode_t mode; /* 0: the best for the size, or as the camera is set */
    int width, height;       /* of the result; 0: as the camera is set */
    dc1394color_coding_t coding; /* of FORMAT7; 0: as the camera is set */
    int left, top, roi_width, roi_height; /* of FORMAT7; 0: all that the sensor has */
    double rate;                          /* frames per second; 0: the fastest */
    dc1394color_filter_t bayer;           /* 0: as the camera says */
};

#endif
