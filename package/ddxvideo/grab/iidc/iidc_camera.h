/* SPDX-License-Identifier: GPL-2.0-or-later */
/* An IIDC camera as the grabber uses it. */
#ifndef DDXVIDEO_IIDC_CAMERA_H
#define DDXVIDEO_IIDC_CAMERA_H

#include "bus.h"
#include "camera.h"
#include "pace.h"
#include "setup.h"
#include "wall.h"

#define IIDC_BUFFERS 8

struct iidc_camera {
    struct camera camera; /* first: this is what the grabber knows */
    struct bus_wish bus;
    struct setup_wish wish;
    char name[32]; /* in messages */
    dc1394_t *library;
    dc1394camera_t *device; /* NULL: closed */
    bool capturing;
    bool counts;  /* the frames have numbers of their own */
    bool gone;    /* an access has failed: no more of them before the camera is opened again */
    bool unplugged; /* `gone`, and why */
    struct pace pace;
    struct wall wall;
    dc1394video_frame_t *taken[IIDC_BUFFERS];
    /* Why it could not be opened last, when that was, and what was on the buses then: */
    int error;
    char why[128];
    int64_t tried;
    uint64_t devices, files;
};

/* Closed; the wishes are to be filled. */
void iidc_camera_init(struct iidc_camera *iidc);

#endif
