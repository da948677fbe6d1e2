/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Positions of all frames in a file, or in all files of a recording. They are found in steps, so that the first picture
 * of a large file can be shown at once. For a file of a recording the whole index is read, for other files their FRAME
 * lines.
 */
#ifndef DDXVIDEO_FRAMES_H
#define DDXVIDEO_FRAMES_H

#include "frames_table.h"

/* Find the files. 0 or -errno. Call frames_close() in each case. */
int frames_open(struct frames *frames, const char *path);
void frames_close(struct frames *frames);

/* Find more positions, for a few ms. -ENOMEM, or 0. */
int frames_work(struct frames *frames);

#endif
