/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Handles each frame of the item. */
#ifndef DDXVIDEO_RECORDER_FRAMES_H
#define DDXVIDEO_RECORDER_FRAMES_H

#include <ddx_request.h>
#include <stdatomic.h>

#include "decimate.h"
#include "disk_watch.h"
#include "preroll.h"
#include "program.h"
#include "recording.h"

#define BACKLOG_MAX 8

/* Closed recordings that are still being written: the thread that takes frames does not wait for them. */
struct backlog {
    struct recording *recording[BACKLOG_MAX]; /* the oldest first */
    unsigned count;
};

struct recorder {
    /* settings: */
    struct program program;
    const char *name;  /* of the video item */
    const char *place; /* file or folder */
    long queue_frames; /* as requested, see recording_queue_frames() */
    long keep_frames;  /* that the store is asked to keep; 0: recorder_run() decides */
    long segment;      /* MB of a file of the pool; 0: no pool */
    bool coded;        /* H.264 in MP4, not Y4M */
    struct h264_settings h264;
    bool recover;             /* finish unfinished recordings, and exit */
    bool paused;              /* frames are left out until a command to record */
    bool recycle;             /* on a full disk, the oldest recording is given up */
    struct decimate decimate; /* the other frames are skipped */
    /* state: */
    struct output output;
    DDX_STATS_BOOK *book;
    DDX_STORE_ITEM *video;
    DDX_REQUESTS *requests; /* commands to this recorder */
    struct pool *pool;
    struct disk_watch disk;
    struct encode_load load;
    struct preroll preroll;            /* while it is paused */
    struct ddxvideo_geometry geometry; /* of the newest picture */
    atomic_uint level;                 /* of the queue, % */
    unsigned keep;                     /* frames that the store keeps for this reader */
    struct recording *recording;       /* the current one; NULL before the first frame */
    struct backlog backlog;            /* former ones, still being written to disk */
    struct recording_turn turn;
    pthread_t mender;               /* repairs what a killed recorder left */
    bool mends;                     /* it was started */
    uint64_t lost_store, lost_ring; /* since the last recorded frame, for the index entry or stamp of the next one */
    int64_t begin;                  /* time of the start */
    bool awaited;                   /* the item did not exist when the recorder started */
    bool said_waiting;              /* the wait for the item was reported */
    bool follows;                   /* frames count from now on */
    bool seen;                      /* a frame has come */
    int frame;                      /* number of the previous frame; -1: none */
    bool queue_full;                /* the previous frame was lost: no room in the queue */
    bool rate_changed;              /* reported */
    bool rate_unknown;              /* reported */
    int status;                     /* exit status so far */
    bool done;
};

/* Print a line and stop recording. `error` is the store's. */
void recorder_fail(struct recorder *recorder, const char *what, int error);

/* Frames of the queue for pictures like the newest one; there must be one. */
unsigned recorder_ring_frames(const struct recorder *recorder);

/* End the current recording with the previous frame; its own threads finish it. */
void recorder_end_file(struct recorder *recorder);

/* Free the former recordings that are on disk by now; with `wait`, wait for all of them. */
void recorder_finish_former(struct recorder *recorder, bool wait);

/* After the first read, which returned `frame` or NULL: this recorder accounts for the frames from then on. */
void recorder_follow(struct recorder *recorder, const struct ddx_frame *frame);

/* Record the frame, leave it out, or count it as lost. */
void recorder_handle(struct recorder *recorder, const struct ddx_frame *frame);

/* Leave frames out from now on; or record, the pictures that wait in memory first. */
void recorder_set_paused(struct recorder *recorder, bool paused);

#endif
