/* SPDX-License-Identifier: GPL-2.0-or-later */
/* An IIDC camera for the grabber. */
#ifndef DDXVIDEO_IIDC_CAMERA_H
#define DDXVIDEO_IIDC_CAMERA_H

#include <dc1394/dc1394.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "camera.h"
#include "pace.h"
#include "setup.h"

/* Finds, lists and opens cameras on FireWire and USB. The requested camera. */
struct bus_wish {
    uint64_t guid; /* 0: not known yet; then this number in the order of GUIDs counts: */
    unsigned number;
};

/* "2" or "00b09d0100abcdef" (16 digits, with or without 0x). False: neither. */
bool bus_parse(const char *text, struct bus_wish *wish);

/* Print all cameras with their modes and rates. Returns the exit status. */
int bus_list(void);

#define IIDC_BUFFERS 8

struct iidc_camera {
    struct camera camera; /* first, since the grabber uses this part */
    struct bus_wish bus;
    struct setup_wish wish;
    char name[32]; /* in messages */
    dc1394_t *library;
    dc1394camera_t *device; /* NULL: closed */
    bool capturing;
    bool counts;    /* the frames carry their own numbers */
    bool gone;      /* an access has failed: no further access until the camera is opened again */
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
