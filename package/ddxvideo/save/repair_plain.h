/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Repairs recordings that a killed recorder left in plain files (those of a pool: pool.h). */
#ifndef DDXVIDEO_REPAIR_PLAIN_H
#define DDXVIDEO_REPAIR_PLAIN_H

#include <ddx_stats.h>

#include "output.h"

/*
 * Cuts the file that a former recorder was writing after its last whole frame, and reports it; removes a file without a
 * frame. Repaired are the file that the counters name, if it is in this folder, and in a folder also the newest
 * recording of this item. A file that another program records into is left alone. Frames of the former file that were
 * written, but not counted, are counted as out.
 */
void repair_plain_files(const struct output *output, DDX_STATS_BOOK *book);

#endif
