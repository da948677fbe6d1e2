/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A recorder's settings and state. */
#ifndef DDXVIDEO_RECORDER_STATE_H
#define DDXVIDEO_RECORDER_STATE_H

#include <ddx_request.h>
#include <stdatomic.h>

#include "backlog.h"
#include "decimate.h"
#include "disk_watch.h"
#include "preroll.h"
#include "program.h"
#include "recording.h"

struct recorder {
    /* settings: */
    struct program program;
    const char *name;  /* of the video item */
    const char *place; /* file or folder */
    long queue_frames; /* as requested, see recording_queue_frames() */
    long keep_frames;  /* that the store is asked to keep; 0: recorder_run() decides */
    long segment;      /* MB of a file of the pool; 0: no pool */
    bool recover;      /* finish unfinished recordings, and exit */
    bool paused;       /* frames are left out until a command to record */
    bool recycle;      /* on a full disk, the oldest recording is given up */
    struct decimate decimate; /* the other frames are skipped */
    /* state: */
    struct output output;
    DDX_STATS_BOOK *book;
    DDX_STORE_ITEM *video;
    DDX_REQUESTS *requests; /* see commands.h */
    struct pool *pool;
    struct disk_watch disk;
    struct preroll preroll;            /* while it is paused */
    struct ddxvideo_geometry geometry; /* of the newest picture */
    atomic_uint level; /* of the queue, % */
    unsigned keep; /* frames that the store keeps for this reader */
    struct recording *recording; /* the current one; NULL before the first frame */
    struct backlog backlog;      /* former ones, still being written to disk */
    struct recording_turn turn;
    uint64_t lost_store, lost_ring; /* since the last recorded frame, for the index entry of the next one */
    int64_t begin;               /* time of the start */
    bool awaited;                /* the item did not exist when the recorder started */
    bool said_waiting;           /* the wait for the item was reported */
    bool follows;                /* frames count from now on */
    bool seen;                   /* a frame has come */
    int frame;                   /* number of the previous frame; -1: none */
    bool queue_full;             /* the previous frame was lost: no room in the queue */
    bool rate_changed;           /* reported */
    bool rate_unknown;           /* reported */
    int status;                  /* exit status so far */
    bool done;
};

#endif
