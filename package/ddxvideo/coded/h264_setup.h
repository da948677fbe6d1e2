/* SPDX-License-Identifier: GPL-2.0-or-later */
/* x264 as recorder and sender use it: one thread, one slice, no delay, parameter sets apart from the frames. */
#ifndef DDXVIDEO_H264_SETUP_H
#define DDXVIDEO_H264_SETUP_H

#include <stdint.h>
#include <x264.h>

#include "ddxvideo.h"

/*
 * Set all that follows from the pictures: layout (GREY8 counts as 4:2:0), range, siting, pixel aspect, rate. 0, or
 * -EIO: there is no such preset.
 */
int h264_set_up(x264_param_t *param, const char *preset, const struct ddxvideo_geometry *geometry, int rate_num,
                int rate_den);

/* The parameter sets of an open encoder, without x264's text on its version and settings; 0, or -EIO. */
int h264_take_sets(x264_t *x264, x264_nal_t *sps, x264_nal_t *pps);

/* The planes of a picture in the encoder's layout. x264 copies them. */
void h264_set_picture(x264_picture_t *in, const struct ddxvideo_picture *picture, int format);

#endif
