/* SPDX-License-Identifier: GPL-2.0-or-later */
/* One output of a graphics card, through the kernel's DRM: its mode, and two buffers that take turns. */
#ifndef DDXVIDEO_KMS_H
#define DDXVIDEO_KMS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <xf86drmMode.h>

#include "surface.h"

struct kms_buffer {
    uint32_t handle, frame; /* DRM's ids; 0: none */
    uint32_t *pixel;        /* NULL: not mapped */
    size_t size;            /* bytes */
    int stride;             /* pixels */
};

struct kms {
    int card; /* file descriptor; -1: closed */
    uint32_t connector, crtc;
    drmModeModeInfo mode;
    drmModeCrtc *before; /* the mode before kms_open(); NULL: not known */
    struct kms_buffer buffer[2];
    int hidden;    /* the buffer that is not shown */
    bool lit;      /* the mode is set, and one buffer is shown */
    bool flipping; /* a flip to the other buffer was requested, and is not confirmed yet */
    char name[64]; /* of output and mode */
};

/*
 * All functions return NULL, or the reason of a failure as a static text, valid until the next call. After a failure of
 * kms_open() nothing is open.
 */
const char *kms_open(struct kms *kms, const struct screen_choice *choice);
void kms_close(struct kms *kms);

/* Call when the card's descriptor is readable: marks a flip as done. */
void kms_read(struct kms *kms);

/* Waits until the hidden buffer is no longer on the screen: at most one refresh. */
const char *kms_wait(struct kms *kms);

/* Show the hidden buffer from the next refresh on; the other one becomes the hidden one. */
const char *kms_flip(struct kms *kms);

/* Whether the kernel knows of the monitor; the monitor itself is not asked. */
bool kms_connected(const struct kms *kms);

#endif
