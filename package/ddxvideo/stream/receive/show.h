/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Writes decoded pictures into the item, and shows them on the screen. If a restored packet releases several frames at
 * once, all of them go into the item, and the newest one onto the screen.
 */
#ifndef DDXVIDEO_SHOW_H
#define DDXVIDEO_SHOW_H

#include "viewer_state.h"

/* Write the picture into the item, count it, and keep it for the screen. */
void show_picture(struct viewer *viewer, const struct assembly_frame *frame, const AVFrame *picture, bool damaged);

/* Show the newest picture on the screen, if there is one. NULL, or the reason of a failure. */
const char *show_newest(struct viewer *viewer);

/* Print why a stream cannot be shown, once a source. */
void show_refusal(struct viewer *viewer);

#endif
