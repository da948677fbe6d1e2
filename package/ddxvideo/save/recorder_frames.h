/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Frame by frame. */
#ifndef DDXVIDEO_RECORDER_FRAMES_H
#define DDXVIDEO_RECORDER_FRAMES_H

#include "recorder_state.h"

/* After the first read, which returned `frame`, or NULL: the frames from then on are this recorder's. */
void recorder_follow(struct recorder *recorder, const struct ddx_frame *frame);

/* Record the frame, leave it out, or count it as lost. */
void recorder_handle(struct recorder *recorder, const struct ddx_frame *frame);

/* Record from now on, what waits in memory first; or leave out what comes. */
void recorder_set_paused(struct recorder *recorder, bool paused);

#endif
