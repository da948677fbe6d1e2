/* SPDX-License-Identifier: GPL-2.0-or-later */
/* From the camera into the store, for as long as the program runs, whatever the camera does. */
#ifndef DDXVIDEO_GRABBER_H
#define DDXVIDEO_GRABBER_H

#include "grabber_state.h"

/* Grab until told to stop; returns the program's exit status. */
int grabber_run(struct grabber *grabber);

#endif
