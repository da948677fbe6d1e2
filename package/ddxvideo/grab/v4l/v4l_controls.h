/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The driver's controls: lists them, follows their events, sets them. */
#ifndef DDXVIDEO_V4L_CONTROLS_H
#define DDXVIDEO_V4L_CONTROLS_H

#include "controls.h"

/* Fill the empty list, and subscribe to the events of its controls. */
void v4l_controls_list(struct controls *controls, int fd);

/* Read a control that has changed again. */
void v4l_controls_follow(struct controls *controls, int fd, uint32_t id);

/* 0, or -errno. */
int v4l_controls_set(int fd, uint32_t id, int value);

#endif
