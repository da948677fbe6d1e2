/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Converts a camera's picture into that of an ideal camera: without distortion, and with the other camera's rows. A
 * table has the position of each pixel in the camera's picture, in 1/32 pixel.
 *
 * The right picture is projected with the left one's centre: a point at infinity has disparity 0 in each calibration.
 */
#ifndef DDXVIDEO_STEREO_RECTIFIER_H
#define DDXVIDEO_STEREO_RECTIFIER_H

#include <stdint.h>

#include "calibration.h"

struct rectifier;

/* For pictures of at least 2x2. NULL: no memory. */
struct rectifier *rectifier_new(const struct calibration *calibration, enum eye eye, int width, int height);
void rectifier_free(struct rectifier *rectifier); /* NULL is allowed */

/* Strides in bytes. `level`: a table for the samples. Points outside of the camera's picture become 0. */
void rectifier_run(const struct rectifier *rectifier, const uint8_t *from, long from_stride, const uint8_t level[256],
                   uint8_t *to, long to_stride);

#endif
