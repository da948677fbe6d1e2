/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The index of a pool file during recording. */
#ifndef DDXVIDEO_SEGMENT_INDEX_H
#define DDXVIDEO_SEGMENT_INDEX_H

#include "frame_queue.h"
#include "segment_state.h"

/* As segment_add(), segment_flush() and segment_finish(), for pool files. */
void segment_index_add(struct segment *segment, const struct frame_queue_frame *frame, uint32_t sum, int64_t latency);
int segment_index_flush(struct segment *segment);
int segment_index_finish(struct segment *segment, bool failed);

#endif
