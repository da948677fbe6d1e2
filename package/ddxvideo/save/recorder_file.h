/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The recorder's current file, and the former ones. */
#ifndef DDXVIDEO_RECORDER_FILE_H
#define DDXVIDEO_RECORDER_FILE_H

#include "recorder_state.h"

/* Print a line and stop recording. `error` is the store's. */
void recorder_fail(struct recorder *recorder, const char *what, int error);

/* Frames of the queue for pictures like the newest one; there must be one. */
unsigned recorder_ring_frames(const struct recorder *recorder);

/* Make sure that the current file fits this frame. False if it cannot be recorded. */
bool recorder_choose_file(struct recorder *recorder, const struct ddxvideo_picture *view);

/* End the current recording with the previous frame; its own threads finish it. */
void recorder_end_file(struct recorder *recorder);

/* Free the former recordings that are on disk by now; with `wait`, wait for all of them. */
void recorder_finish_former(struct recorder *recorder, bool wait);

#endif
