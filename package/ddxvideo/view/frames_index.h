/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Positions of the frames in one file, from its index or from the file itself. */
#ifndef DDXVIDEO_FRAMES_INDEX_H
#define DDXVIDEO_FRAMES_INDEX_H

#include "frames_table.h"
#include "y4m.h"

/* Read the header of an open Y4M file. Its length, or 0 and a text in error[Y4M_ERROR_MAX]. */
size_t frames_header(int fd, struct y4m_header *header, char *error);

/* 0: all of the index was read. -ENOMEM; -EBADMSG: it is damaged or cannot be read. */
int frames_index_read(struct frames *frames, struct frames_part *part);

/* Read the next FRAME lines. 1: there are more; 0: there are no more; -ENOMEM. */
int frames_scan(struct frames *frames, struct frames_part *part);
void frames_scan_end(struct frames *frames);

#endif
