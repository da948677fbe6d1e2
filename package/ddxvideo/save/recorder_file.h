/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The file that a recorder writes to now, and those that it wrote to before. */
#ifndef DDXVIDEO_RECORDER_FILE_H
#define DDXVIDEO_RECORDER_FILE_H

#include "recorder_state.h"

/* One line, and the end of the recording. `error` is the store's. */
void recorder_fail(struct recorder *recorder, const char *what, int error);

/* Size of its queue for pictures like the newest one, which there is. */
unsigned recorder_ring_frames(const struct recorder *recorder);

/* Make sure that the present file fits this frame. False if it cannot be recorded. */
bool recorder_choose_file(struct recorder *recorder, const struct ddxvideo_picture *view);

/* The present recording ends with the frame before; it is finished by its own threads. */
void recorder_end_file(struct recorder *recorder);

/* Free the former recordings that are on disk by now; or, waiting for it, all. */
void recorder_finish_former(struct recorder *recorder, bool wait);

#endif
