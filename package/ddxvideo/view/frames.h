/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Where each frame of a file, or of all files of a recording, lies. It becomes known bit by bit, so that the first
 * picture of a large file is there at once: the index of a recording's file is read as a whole, of other files the
 * FRAME lines are.
 */
#ifndef DDXVIDEO_FRAMES_H
#define DDXVIDEO_FRAMES_H

#include "frames_table.h"

/* Find out which files there are. 0 or -errno. frames_close() in any case. */
int frames_open(struct frames *frames, const char *path);
void frames_close(struct frames *frames);

/* Learn more of them, for a few ms. -ENOMEM, or 0. */
int frames_work(struct frames *frames);

#endif
