/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The frame that is shown as a PNG file. */
#ifndef DDXVIDEO_SAVE_H
#define DDXVIDEO_SAVE_H

#include "view.h"

/*
 * Into the present folder, as `video-000123.png`, or `video-000123-2.png` where a file has that name. All pixels of all
 * fields, whatever is shown of them. A message says what came of it.
 */
void save_shot(struct view *view);

#endif
