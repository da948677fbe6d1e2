/* SPDX-License-Identifier: GPL-2.0-or-later */
/* One file being recorded: a ring, and a thread that writes it to disk. */
#ifndef DDXVIDEO_RECORDING_H
#define DDXVIDEO_RECORDING_H

#include <ddx_stats.h>

#include "ddxvideo.h"
#include "output.h"

/* Reasons of loss, in the order of the names given to ddx_stats_open(). */
enum { LOST_STORE, LOST_RING, LOST_WRITE };

struct recording;

/* Ring size for pictures like these: 2.5 s and at least 64 frames, as far as memory allows. */
unsigned recording_ring_frames(const struct ddxvideo_geometry *geometry);

/*
 * Open the next file of `output` and begin to record. `first` is the first frame, of which only geometry and times are
 * used; `published` as in recording_put(). The book is told what becomes of each frame. 0 or -errno.
 */
int recording_begin(const struct output *output, const struct ddxvideo_picture *first, int64_t published,
                    unsigned ring_frames, DDX_STATS_BOOK *book, struct recording **recording);

/*
 * Copy a frame into the ring; `published` is when it was written into the store. Never waits. False if the ring is
 * full; the frame is counted as lost then.
 */
bool recording_put(struct recording *recording, const struct ddxvideo_picture *view, int64_t published);

const struct ddxvideo_geometry *recording_geometry(const struct recording *recording);
const char *recording_path(const struct recording *recording);

/* 0, or -errno after which nothing more gets to disk. What was recorded until then stays readable. */
int recording_error(const struct recording *recording);

/* No more frames; does not wait. */
void recording_close(struct recording *recording);

/* Wait until all is on disk, free the recording. 0, or -errno as recording_error(). */
int recording_finish(struct recording *recording);

#endif
