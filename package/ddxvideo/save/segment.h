/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A file of a recording: a plain file, or one of the pool, which has an index and is overwritten in place. One thread
 * writes, another flushes.
 */
#ifndef DDXVIDEO_SEGMENT_H
#define DDXVIDEO_SEGMENT_H

#include "frame_queue.h"
#include "output.h"
#include "segment_state.h"

/*
 * Open the next file of `output`, of the pool unless that is NULL. 0 or -errno. The book counts a frame as out when it
 * is written, or in a pool when it is in the index on the disk, since only those frames survive this program.
 * `session`: number of the recording's first segment; 0 if this one is the first.
 */
int segment_open(const struct output *output, struct pool *pool, DDX_STATS_BOOK *book, uint32_t session,
                 struct segment **segment);

/* ---- The thread that writes ---- */

/* Write the next bytes; in the queue they are aligned as in the file. Returns how many were written, or -errno. */
ssize_t segment_write(struct segment *segment, const unsigned char *bytes, size_t size);

/* A frame is complete: its place in the queue, and its checksum. */
void segment_add(struct segment *segment, const struct frame_queue_frame *frame, uint32_t sum);

/* ---- The thread that flushes ---- */

/* Bring the complete frames to the disk, and then their index entries. Waits for the disk. 0 or -errno. */
int segment_flush(struct segment *segment);

/* Whether the disk shows it as a recording: a plain file always, one of a pool from the first index entry on. */
bool segment_is_promised(const struct segment *segment);

/*
 * Bring all of it to the disk under its name; after an error, only the frames that were complete or promised before. A
 * file without a frame is not kept. Frees the segment. 0 or -errno.
 */
int segment_finish(struct segment *segment, bool failed);

#endif
