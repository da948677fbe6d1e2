/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Receives a stream, and puts its pictures into an item, onto a screen, into a file. */
#ifndef DDXVIDEO_VIEWER_H
#define DDXVIDEO_VIEWER_H

#include "viewer_state.h"

/* Show until a stop is requested. Returns the exit status. */
int viewer_run(struct viewer *viewer);

#endif
