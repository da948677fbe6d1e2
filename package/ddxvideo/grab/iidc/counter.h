/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The counter that Point Grey's cameras write into the first pixels of each frame. */
#ifndef DDXVIDEO_COUNTER_H
#define DDXVIDEO_COUNTER_H

#include <dc1394/dc1394.h>
#include <stdbool.h>

/* Switch it on (`wanted`) or off. Returns whether the frames have it now. */
bool counter_switch(dc1394camera_t *device, bool wanted);

/* Read it from a frame, and replace it by the pixels two rows below, which have the same colours. */
uint32_t counter_take(dc1394video_frame_t *frame);

#endif
