/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A recording of pictures with one geometry: a queue; a thread that writes it to disk, with a pool into one file after
 * the other; and a thread that flushes the written bytes.
 */
#ifndef DDXVIDEO_RECORDING_H
#define DDXVIDEO_RECORDING_H

#include <ddx_stats.h>
#include <pthread.h>

#include "ddxvideo.h"
#include "coded_frames.h"
#include "encode_load.h"
#include "h264_encode.h"
#include "output.h"
#include "segment.h"

/* Recordings of one recorder write to disk one after the other, so that their files are numbered in order. */
struct recording_turn {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    unsigned begun, written; /* recordings so far, and the repair of what a killed recorder left */
};

/* The oldest one that has begun is written: the next one may write. */
void recording_end_turn(struct recording_turn *turn);

/* Settings of a recording. */
struct recording_plan {
    const struct output *output;
    struct pool *pool; /* NULL: one file */
    struct ddxvideo_geometry geometry;
    struct encode_load *load;         /* of MP4: counts time and coarser frames */
    const struct h264_settings *h264; /* MP4 with H.264, of a geometry that h264_refusal() takes; NULL: Y4M */
    struct coded_frames *coded;       /* MP4: encoder of its first pictures, of this geometry; the recording takes it.
                                         NULL: a new one */
    unsigned queue_frames;
    struct recording_turn *turn;
    uint64_t lost_store, lost_ring; /* before its first frame */
    DDX_STATS_BOOK *book;           /* counts each frame's outcome */
};

struct recording;

/* A picture that was encoded before its recording began. */
struct recording_encoded {
    struct coded_picture picture;
    size_t bytes; /* room for its frame in a file; of a key frame also for those after it up to the next one */
};

/*
 * Size of the queue for such pictures, in frames: 2.5 s, at least 64 frames, and at most recording_queue_bytes_max().
 * If `asked` is not 0: that many, in at most a quarter of the machine's memory. Never fewer than 8, or `asked`.
 */
unsigned recording_queue_frames(const struct ddxvideo_geometry *geometry, unsigned asked);

/* 256 MiB, on a small machine a quarter of its memory. */
uint64_t recording_queue_bytes_max(void);

/* Memory of the queue for encoded frames instead of that many raw ones; *list: frames that may wait in it. */
size_t recording_coded_memory(const struct ddxvideo_geometry *geometry, unsigned queue_frames, unsigned *list);

/* When a frame was captured; an item without times (the paper's seven fields) has only the time of the write. */
int64_t recording_time(const struct ddxvideo_picture *view, int64_t published);

/* Whether one file can hold pictures of both: the same layout, rate and pixel aspect. */
bool recording_same_header(const struct ddxvideo_geometry *a, const struct ddxvideo_geometry *b);

/* Memory of a frame in the queue: its bytes, and its entry in the list. */
uint64_t recording_frame_memory(const struct ddxvideo_geometry *geometry);

/*
 * Begin to record. The writing thread opens the first file, so that the caller does not wait for the disk. 0 or -errno;
 * -EFBIG if a frame does not fit into a file of the pool, -EIO if the encoder cannot be opened.
 */
int recording_begin(const struct recording_plan *plan, struct recording **recording);

/* Facts on a frame, beside its picture. */
struct recording_frame {
    int64_t published; /* time of its write into the store */
    uint64_t sequence; /* in the store */
    uint64_t missed;   /* frames lost in the store before it */
    unsigned late;     /* %: of the time that the store keeps it, so much had passed when it was taken */
    const struct recording_encoded *encoded; /* NULL: not encoded yet */
};

/*
 * Copy a frame into the queue, encoded if `plan.h264` is set. Quality gives way before frames do: as soon as frames are
 * taken late, or the queue is half full, frames are coarser until that is over. Never waits for the disk. False if the
 * queue is full: then the frame is counted as lost, also in the index entry or stamp of the next one. So is a frame
 * whose encoding failed; a line reports that, and the result is true.
 */
bool recording_put(struct recording *recording, const struct ddxvideo_picture *view,
                   const struct recording_frame *frame);

/*
 * Whether this frame comes so long after the previous one that an MP4 file cannot express it. In a pool never: there
 * recording_put() begins the next file.
 */
bool recording_is_gap(const struct recording *recording, const struct ddxvideo_picture *view,
                      const struct recording_frame *frame);

/* Bytes of a frame in the files, on average; before the first one, those of the picture. */
unsigned recording_frame_bytes(const struct recording *recording);

/*
 * In a pool: the next frame begins a new recording, without a gap to this one. Does not wait: while the queue has no
 * room for the end of a file, a later frame begins it.
 */
void recording_split(struct recording *recording);

/* Count frames that could not be read, in the index entry of the next one. */
void recording_missed(struct recording *recording, uint64_t frames);

const struct ddxvideo_geometry *recording_geometry(const struct recording *recording);

/* Memory of its queue, the list of frames included. */
uint64_t recording_queue_bytes(const struct recording *recording);

/* How full the queue is: 0 to 100. */
unsigned recording_level(struct recording *recording);

/* 0, or the -errno that stopped the writing: no file, or one that can no longer be written. */
int recording_error(const struct recording *recording);

/* No more frames; does not wait. */
void recording_close(struct recording *recording);

/* Whether a closed recording is on disk, or has failed: then recording_finish() does not wait. */
bool recording_is_on_disk(const struct recording *recording);

/*
 * Wait until all is on disk, and free the recording. `path` (PATH_MAX) becomes that of its last file, "" if there was
 * none. 0, or -errno as recording_error().
 */
int recording_finish(struct recording *recording, char *path);

#endif
