/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The camera's features as controls: `gain`; `gain_auto`; `gain_one_push`, a button; `gain_on`. Setting a value
 * switches the automatic off.
 */
#ifndef DDXVIDEO_IIDC_CONTROLS_H
#define DDXVIDEO_IIDC_CONTROLS_H

#include <dc1394/dc1394.h>

#include "controls.h"

/* Fill the empty list. */
void features_list(dc1394camera_t *device, struct controls *controls);

/* Read all values from the camera again. */
void features_refresh(dc1394camera_t *device, struct controls *controls);

/* 0; -EIO: the camera does not accept it; -EINVAL: no such control. */
int features_set(dc1394camera_t *device, uint32_t id, int value);

/* Whether it can change the rate of the frames. */
bool features_changes_rate(uint32_t id);

#endif
