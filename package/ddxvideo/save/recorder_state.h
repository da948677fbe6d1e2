/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What a recorder is to do, and how it stands. */
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
    /* what to do */
    struct program program;
    const char *name;  /* of the video item */
    const char *place; /* file or folder */
    long queue_frames; /* that were asked for, see recording_queue_frames() */
    long keep_frames;  /* that the store is to keep for us; 0: as recorder_run() sees fit */
    long segment;      /* MB of a file of the pool; 0: no pool */
    bool recover;      /* what was left unfinished, and nothing else */
    bool paused;       /* frames are left out, until an order to record comes */
    bool recycle;      /* of the full disk's recordings the oldest is given up */
    struct decimate decimate; /* of the frames: the others are skipped, as if they had not been there */
    /* how it stands */
    struct output output;
    DDX_STATS_BOOK *book;
    DDX_STORE_ITEM *video;
    DDX_REQUESTS *requests; /* see commands.h */
    struct pool *pool;
    struct disk_watch disk;
    struct preroll preroll;            /* while it is paused */
    struct ddxvideo_geometry geometry; /* of the newest picture */
    atomic_uint level; /* of the queue, % */
    unsigned keep; /* frames that the store keeps for us */
    struct recording *recording; /* the present one, NULL before the first frame */
    struct backlog backlog;      /* former ones, which are still being written to disk */
    struct recording_turn turn;
    uint64_t lost_store, lost_ring; /* since the last frame that a recording took: the next one's index tells of them */
    int64_t begin;               /* when the program was told to record */
    bool awaited;                /* the item was not there when the recorder started */
    bool said_waiting;           /* for it */
    bool follows;                /* what is written into the item from now on is ours to record */
    bool seen;                   /* a frame was there */
    int frame;                   /* number of the frame before; -1: there was none */
    bool queue_full;             /* the frame before was lost in the queue */
    bool rate_changed;           /* said so */
    bool rate_unknown;           /* likewise */
    int status;                  /* exit status so far */
    bool done;
};

#endif
