/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A camera through Video4Linux: its inputs and television standards, and what its driver agrees to. Nothing waits. */
#ifndef DDXVIDEO_DEVICE_H
#define DDXVIDEO_DEVICE_H

#include <ddxvideo.h>
#include <linux/videodev2.h>

#include "pixels.h"
#include "video_layout.h"

#define DEVICE_BUFFERS 8

/* Requested settings. */
struct device_wish {
    char path[64];
    int width, height;    /* of the result; 0: as the camera is set */
    const char *input;    /* name or number; NULL: as it is set */
    const char *standard; /* NULL: that of the signal, if the driver can detect it, otherwise as it is set */
    uint32_t fourcc;      /* 0: the best */
    const struct video_layout *layout; /* of the result */
    long rate;                         /* frames per second; 0: as it is set */
    bool fields;                       /* both fields of a picture are needed */
};

struct device {
    int fd; /* -1: closed */
    char card[33];
    struct pixels pixels;
    struct ddxvideo_geometry geometry; /* of the camera's pictures, not of the result */
    unsigned buffers;
    bool streaming;
    struct {
        void *data;
        size_t size;
    } buffer[DEVICE_BUFFERS];
};

/* ioctl() that returns -errno, and is repeated after a signal. */
int device_ioctl(int fd, unsigned long request, void *argument);

/* ---- The socket of a frame grabber, and the television standard ---- */

/* "PAL", "NTSC", "SECAM" in any case; false: another name. */
bool input_parse_standard(const char *text, v4l2_std_id *standard);

/* Whether a camera's input is meant by `text`: its number, its name, or how its name begins, in any case. */
bool input_is_meant(const struct v4l2_input *input, const char *text);

/* Select both; NULL: no change (the standard: that of the signal, if it can be detected). 0 or -errno, and `why`. */
int input_select(int fd, const char *input, const char *standard, char *why, size_t size);

/* ---- Pixel format, size, rate, fields, range and pixel aspect, negotiated with the driver ---- */

/* The format of a name in -format, in any case; 0: unknown. */
uint32_t negotiate_fourcc(const char *name);

/* Fills device->pixels and device->geometry. Errors as device_open(). */
int negotiate(struct device *device, const struct device_wish *wish, char *why, size_t size);

#endif
