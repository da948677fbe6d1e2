/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Where the frames of one file are: from its index, or from the file. */
#ifndef DDXVIDEO_FRAMES_INDEX_H
#define DDXVIDEO_FRAMES_INDEX_H

#include "frames_table.h"
#include "y4m.h"

/* The header of a Y4M file that is open: its length, or 0 and a text in error[Y4M_ERROR_MAX]. */
size_t frames_header(int fd, struct y4m_header *header, char *error);

/* 0: all of it was read. -ENOMEM; -EBADMSG: it is damaged, or not to be had. */
int frames_index_read(struct frames *frames, struct frames_part *part);

/* Read on from FRAME line to FRAME line: 1, there is more; 0, there is no more; -ENOMEM. */
int frames_scan(struct frames *frames, struct frames_part *part);
void frames_scan_end(struct frames *frames);

#endif
