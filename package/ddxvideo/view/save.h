/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Saves the frame on display as a PNG file. */
#ifndef DDXVIDEO_SAVE_H
#define DDXVIDEO_SAVE_H

#include "view.h"

/*
 * Write into the current folder `video-000123.png`, or `video-000123-2.png` if that file exists: all pixels of all
 * fields, even if some are not on display. A message has the file's name or the error.
 */
void save_shot(struct view *view);

#endif
