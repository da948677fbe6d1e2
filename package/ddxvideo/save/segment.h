/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * One file that is being recorded to: one with a name of its own, or one of the pool, which has an index and is
 * overwritten in place. One thread writes, another makes safe what has been written.
 */
#ifndef DDXVIDEO_SEGMENT_H
#define DDXVIDEO_SEGMENT_H

#include "frame_queue.h"
#include "output.h"
#include "segment_state.h"

/*
 * Open the next file of `output`, in its pool unless that is NULL. 0 or -errno. Each frame that is out is counted in
 * the book: written, or in a pool promised by the index, since only that survives this program. `session`: number of
 * the segment that began what this one continues; 0 if it begins something itself.
 */
int segment_open(const struct output *output, struct pool *pool, DDX_STATS_BOOK *book, uint32_t session,
                 struct segment **segment);

/* ---- The thread that writes ---- */

/* Write the next bytes; they lie in the queue, where they are aligned like the file. Returns how many, or -errno. */
ssize_t segment_write(struct segment *segment, const unsigned char *bytes, size_t size);

/* A frame is whole: its place in the queue, and its sum. */
void segment_add(struct segment *segment, const struct frame_queue_frame *frame, uint32_t sum);

/* ---- The thread that makes safe ---- */

/* What is whole now is on the disk, and then promised by the index. Waits for the disk. 0 or -errno. */
int segment_flush(struct segment *segment);

/* Whether the disk knows of it: always, if it has a name of its own; in a pool with the first frame promised. */
bool segment_is_promised(const struct segment *segment);

/*
 * Nothing more comes: all of it is on the disk, under its name; or, after an error, what was whole or promised until
 * then. A file without a frame is not kept. Frees the segment. 0 or -errno.
 */
int segment_finish(struct segment *segment, bool failed);

#endif
