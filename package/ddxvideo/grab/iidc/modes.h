/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Names and numbers of IIDC's modes, codings and rates. */
#ifndef DDXVIDEO_MODES_H
#define DDXVIDEO_MODES_H

#include <dc1394/dc1394.h>
#include <stdbool.h>

#include "pixels.h"

#define MODE_NAMES "640x480_MONO8 and the like, FORMAT7_0 to FORMAT7_7"
#define CODING_NAMES "MONO8, MONO16, YUV411, YUV422, YUV444, RGB8, RGB16, RAW8, RAW16"
#define BAYER_NAMES "RGGB, GBRG, GRBG, BGGR"

/* Upper or lower case. False: no such name. */
bool mode_parse(const char *text, dc1394video_mode_t *mode);
bool mode_parse_coding(const char *text, dc1394color_coding_t *coding);
bool mode_parse_bayer(const char *text, dc1394color_filter_t *bayer);

const char *mode_name(dc1394video_mode_t mode);
const char *mode_coding_name(dc1394color_coding_t coding); /* NULL: unknown */

/* How well a coding suits without -mode; 0: not at all. */
int mode_merit(dc1394color_coding_t coding);

/* The pixel format of a coding in memory. `bayer`: the sensor's pattern; 0: none. */
enum pixels_coding mode_pixels(dc1394color_coding_t coding, dc1394color_filter_t bayer);

/* Frames per second, as a fraction. */
void mode_rate(dc1394framerate_t rate, int *num, int *den);

#endif
