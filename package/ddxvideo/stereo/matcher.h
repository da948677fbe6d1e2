/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Disparities of a rectified pair: semi-global matching over four paths, on census 5x5.
 *
 * A pixel x of the left picture is at x - d in the right one; the disparity d is in 1/16 pixel, 0 where it is unknown.
 * The same pictures give the same bits on each processor.
 */
#ifndef DDXVIDEO_STEREO_MATCHER_H
#define DDXVIDEO_STEREO_MATCHER_H

#include <stdint.h>

#include "matcher_settings.h"

struct matcher;

/* NULL and errno: ENOMEM, EINVAL (settings), ENOSYS (the processor does not support the variant). */
struct matcher *matcher_new(const struct matcher_settings *settings);
void matcher_free(struct matcher *matcher);

/* The name of the variant in use. */
const char *matcher_variant(const struct matcher *matcher);

/* Strides in bytes; disparities have no padding. */
void matcher_run(struct matcher *matcher, const uint8_t *left, long left_stride, const uint8_t *right,
                 long right_stride, uint16_t *disparity);

#endif
