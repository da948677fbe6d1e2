/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Decoded pictures into the item, and onto the screen: of the frames that come at once, because a restored packet set
 * them free, every one goes into the item, and the newest one onto the screen.
 */
#ifndef DDXVIDEO_SHOW_H
#define DDXVIDEO_SHOW_H

#include "viewer_state.h"

/* Write the picture into the item, count it, and keep it for the screen. */
void show_picture(struct viewer *viewer, const struct assembly_frame *frame, const AVFrame *picture, bool damaged);

/* The newest picture onto the screen, if there is one. NULL, or what went wrong. */
const char *show_newest(struct viewer *viewer);

/* Print why a stream cannot be shown, once a source. */
void show_refusal(struct viewer *viewer);

#endif
