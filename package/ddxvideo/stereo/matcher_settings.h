/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Settings of the matcher and its filter. */
#ifndef DDXVIDEO_STEREO_MATCHER_SETTINGS_H
#define DDXVIDEO_STEREO_MATCHER_SETTINGS_H

#define MATCHER_SUBPIXEL 16
#define MATCHER_LEAST_WIDTH 64
#define MATCHER_LEAST_HEIGHT 5

struct matcher_settings {
    int width, height;
    int disparities; /* 16 to 256, a multiple of 16, at most the width; sets the nearest distance */
    int uniqueness;  /* a disparity is unknown if another one costs less than this many percent more; 0 to 99 */
    int agreement;   /* or if both directions differ by more than this many pixels */
    int speckle;     /* or if its patch of similar disparities has fewer pixels than this; 0: no such filter */
    const char *variant; /* scalar, mmx, sse2 or avx2; NULL: the quickest that this processor has */
};

#endif
