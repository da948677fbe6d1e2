/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_RECORDER_H
#define DDXVIDEO_RECORDER_H

#include "program.h"
#include "recording.h"

struct recorder {
    /* what to do */
    struct program program;
    const char *name;  /* of the video item */
    const char *place; /* file or folder */
    long ring_frames;  /* 0: as recording_ring_frames() says */
    /* how it stands */
    struct output output;
    DDX_STATS_BOOK *book;
    DDX_STORE_ITEM *video;
    struct recording *recording; /* the present one, NULL before the first frame */
    struct recording *former;    /* one that is still being written to disk, or NULL */
    int64_t begin;               /* when the program was told to record */
    bool seen, delivered;        /* a frame was there; a frame has been counted */
    int frame;                   /* number of the frame before */
    bool ring_full;              /* the frame before was lost in the ring */
    bool rate_changed;           /* said so */
    int status;                  /* exit status so far */
    bool done;
};

/* Record until told to stop; returns the program's exit status. */
int recorder_run(struct recorder *recorder);

#endif
