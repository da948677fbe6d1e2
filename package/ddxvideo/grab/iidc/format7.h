/* SPDX-License-Identifier: GPL-2.0-or-later */
/* FORMAT7: any part of the picture, in one of several codings; the size of the packets sets the rate. */
#ifndef DDXVIDEO_FORMAT7_H
#define DDXVIDEO_FORMAT7_H

#include "setup_wish.h"

/* Set coding, part of the picture, size of packets. Fills the geometry's rate, if it is known. As setup_camera(). */
int format7_set(dc1394camera_t *device, dc1394video_mode_t mode, const struct setup_wish *wish, bool firewire,
                struct ddxvideo_geometry *geometry, char *why, size_t size);

/* The sensor's Bayer pattern. -ENODATA: the camera does not report it. */
int format7_bayer(dc1394camera_t *device, dc1394video_mode_t mode, dc1394color_filter_t *bayer);

#endif
