/* SPDX-License-Identifier: GPL-2.0-or-later */
/* From the packets of a stream to pictures in an item, on a screen, in a file. */
#ifndef DDXVIDEO_VIEWER_H
#define DDXVIDEO_VIEWER_H

#include "viewer_state.h"

/* Show until told to stop; returns the program's exit status. */
int viewer_run(struct viewer *viewer);

#endif
