/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What a recorder that was killed left behind, in files with names of their own (those of a pool: pool.h). */
#ifndef DDXVIDEO_REPAIR_PLAIN_H
#define DDXVIDEO_REPAIR_PLAIN_H

#include <ddx_stats.h>

#include "output.h"

/*
 * Cut the file that a former recorder was writing behind its last whole frame, after a line; one without a frame is
 * removed. Looked at are the file that the book tells of, if it is in this folder, and in a folder also the newest
 * recording of this item. What another program records into stays as it is. Frames in the first one that the former
 * program had written, but not counted, are counted as out.
 */
void repair_plain_files(const struct output *output, DDX_STATS_BOOK *book);

#endif
