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

#define MATCHER_SUBPIXEL 16
#define MATCHER_LEAST_WIDTH 64
#define MATCHER_LEAST_HEIGHT 5

/* Settings of the matcher and its filter. */
struct matcher_settings {
    int width, height;
    int disparities;     /* 16 to 256, a multiple of 16, at most the width; sets the nearest distance */
    int uniqueness;      /* a disparity is unknown if another one costs less than this many percent more; 0 to 99 */
    int agreement;       /* or if both directions differ by more than this many pixels */
    int speckle;         /* or if its patch of similar disparities has fewer pixels than this; 0: no such filter */
    const char *variant; /* scalar, mmx, sse2 or avx2; NULL: the quickest that this processor has */
};

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
