/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Opens a camera and starts its stream. */
#ifndef DDXVIDEO_DEVICE_OPEN_H
#define DDXVIDEO_DEVICE_OPEN_H

#include "device.h"

/*
 * Open the camera, set it up and start the stream. 0, or -errno with the reason in one line at `why`; then it is
 * closed. -EINVAL: this camera cannot do what is requested.
 */
int device_open(struct device *device, const struct device_wish *wish, char *why, size_t size);

#endif
