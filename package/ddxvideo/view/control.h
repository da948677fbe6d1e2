/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Chooses the frame to show, by keys and by time. */
#ifndef DDXVIDEO_CONTROL_H
#define DDXVIDEO_CONTROL_H

#include "view.h"

void control_pause(struct view *view);
/* Pause, and step by this number of frames, forward or back. */
void control_step(struct view *view, int frames);
void control_seconds(struct view *view, int seconds);
/* Go to the oldest (-1) or the newest (1) frame. */
void control_end(struct view *view, int direction);
/* Open the next (1) or previous (-1) video item of the store. */
void control_item(struct view *view, int direction);

/* Show the frame that is due now. */
void control_advance(struct view *view);

/* ms until the next frame of a file is due; at most `most`. */
int control_wait(struct view *view, int most);

#endif
