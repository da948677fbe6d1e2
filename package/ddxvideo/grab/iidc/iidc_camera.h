/* SPDX-License-Identifier: GPL-2.0-or-later */
/* An IIDC camera for the grabber. */
#ifndef DDXVIDEO_IIDC_CAMERA_H
#define DDXVIDEO_IIDC_CAMERA_H

#include "bus.h"
#include "camera.h"
#include "pace.h"
#include "setup.h"
#include "wall.h"

#define IIDC_BUFFERS 8

struct iidc_camera {
    struct camera camera; /* first, since the grabber uses this part */
    struct bus_wish bus;
    struct setup_wish wish;
    char name[32]; /* in messages */
    dc1394_t *library;
    dc1394camera_t *device; /* NULL: closed */
    bool capturing;
    bool counts;  /* the frames carry their own numbers */
    bool gone;    /* an access has failed: no further access until the camera is opened again */
    bool unplugged; /* the reason for `gone` */
    struct pace pace;
    struct wall wall;
    dc1394video_frame_t *taken[IIDC_BUFFERS];
    /* The last failure to open it: the reason, the time, and the devices on the buses: */
    int error;
    char why[128];
    int64_t tried;
    uint64_t devices, files;
};

/* Start as closed; the caller then fills in the wishes. */
void iidc_camera_init(struct iidc_camera *iidc);

#endif
