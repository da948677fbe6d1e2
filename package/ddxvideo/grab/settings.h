/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The camera's settings in the store: item `<name>.parameters`, and requests. */
#ifndef DDXVIDEO_SETTINGS_H
#define DDXVIDEO_SETTINGS_H

#include "grabber_state.h"

/* Call when the camera was opened. */
void settings_begin(struct grabber *grabber);

/* Answer a request, if there is one; write the parameters, if they have changed. Call it often. */
void settings_tick(struct grabber *grabber);

/* Close the items. */
void settings_end(struct grabber *grabber);

#endif
