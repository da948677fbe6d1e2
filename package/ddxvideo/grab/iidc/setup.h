/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Sets the camera up: mode, coding, part of the picture, rate; and their names. */
#ifndef DDXVIDEO_SETUP_H
#define DDXVIDEO_SETUP_H

#include <dc1394/dc1394.h>
#include <ddxvideo.h>
#include <stdbool.h>

#include "pixels.h"
#include "video_layout.h"

/* ---- Names and numbers of modes, codings and rates ---- */

#define MODE_NAMES "640x480_MONO8 and the like, FORMAT7_0 to FORMAT7_7"
#define CODING_NAMES "MONO8, MONO16, YUV411, YUV422, YUV444, RGB8, RGB16, RAW8, RAW16"
#define BAYER_NAMES "RGGB, GBRG, GRBG, BGGR"

/* Upper or lower case. False: no such name. */
bool mode_parse(const char *text, dc1394video_mode_t *mode);
bool mode_parse_coding(const char *text, dc1394color_coding_t *coding);
bool mode_parse_bayer(const char *text, dc1394color_filter_t *bayer);

const char *mode_name(dc1394video_mode_t mode);
const char *mode_coding_name(dc1394color_coding_t coding); /* NULL: unknown */

/* Frames per second, as a fraction. */
void mode_rate(dc1394framerate_t rate, int *num, int *den);

/* ---- The camera ---- */

/* The requested settings. */
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
