/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Grabs from a camera into the store; a camera that fails or is unplugged is opened again. */
#ifndef DDXVIDEO_GRABBER_H
#define DDXVIDEO_GRABBER_H

#include "grabber_state.h"

/* Grab until a stop is requested. Returns the exit status. */
int grabber_run(struct grabber *grabber);

#endif
