/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A Video4Linux camera as the grabber uses it. */
#ifndef DDXVIDEO_V4L_CAMERA_H
#define DDXVIDEO_V4L_CAMERA_H

#include "camera.h"
#include "device.h"
#include "reorder.h"

struct v4l_camera {
    struct camera camera; /* first, since the grabber uses this part */
    struct device_wish wish;
    struct device device;
    struct order order;
    struct v4l2_buffer taken[DEVICE_BUFFERS]; /* of waiting frames */
};

/* Start as closed; the caller then fills in `wish`. */
void v4l_camera_init(struct v4l_camera *v4l);

#endif
