/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The driver's controls: read into the list, followed by its events, set. */
#ifndef DDXVIDEO_V4L_CONTROLS_H
#define DDXVIDEO_V4L_CONTROLS_H

#include "controls.h"

/* Fill the empty list, and listen to the events of what is in it. */
void v4l_controls_list(struct controls *controls, int fd);

/* A control has changed: look at it again. */
void v4l_controls_follow(struct controls *controls, int fd, uint32_t id);

/* 0, or -errno. */
int v4l_controls_set(int fd, uint32_t id, int value);

#endif
