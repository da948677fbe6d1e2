/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Negotiates pixel format, size, rate, fields, range and pixel aspect with the driver. */
#ifndef DDXVIDEO_NEGOTIATE_H
#define DDXVIDEO_NEGOTIATE_H

#include "device.h"

/* The format of a name in -format, in any case; 0: unknown. */
uint32_t negotiate_fourcc(const char *name);

/* Fills device->pixels and device->geometry. Errors as device_open(). */
int negotiate(struct device *device, const struct device_wish *wish, char *why, size_t size);

#endif
