/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Handles each frame of the item. */
#ifndef DDXVIDEO_RECORDER_FRAMES_H
#define DDXVIDEO_RECORDER_FRAMES_H

#include "recorder_state.h"

/* After the first read, which returned `frame` or NULL: this recorder accounts for the frames from then on. */
void recorder_follow(struct recorder *recorder, const struct ddx_frame *frame);

/* Record the frame, leave it out, or count it as lost. */
void recorder_handle(struct recorder *recorder, const struct ddx_frame *frame);

/* Leave frames out from now on; or record, the pictures that wait in memory first. */
void recorder_set_paused(struct recorder *recorder, bool paused);

#endif
