/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Where the frames of one file are: from its index, or from the file. For frames.c. */
#ifndef DDXVIDEO_FRAMES_INDEX_H
#define DDXVIDEO_FRAMES_INDEX_H

#include "frames.h"

/* -ENOMEM or 0. */
int frames_add(struct frames *frames, const struct frames_entry *entry);

/* 0: all of it was read. -ENOMEM; -EBADMSG: it is damaged, or not to be had. */
int frames_index_read(struct frames *frames, struct frames_part *part);

/* Read on from FRAME line to FRAME line: 1, there is more; 0, there is no more; -ENOMEM. */
int frames_scan(struct frames *frames, struct frames_part *part);
void frames_scan_end(struct frames *frames);

#endif
