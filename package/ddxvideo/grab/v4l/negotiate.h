/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What the camera gives: pixel format, size, rate, fields, range and shape of its pixels. */
#ifndef DDXVIDEO_NEGOTIATE_H
#define DDXVIDEO_NEGOTIATE_H

#include "device.h"

/* What -format takes, in any case; 0: unknown. */
uint32_t negotiate_fourcc(const char *name);

/* Fills device->pixels and device->geometry. As device_open(). */
int negotiate(struct device *device, const struct device_wish *wish, char *why, size_t size);

#endif
