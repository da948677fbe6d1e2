/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What a grabber is to do, and how it stands: camera, frames, items. */
#ifndef DDXVIDEO_GRABBER_STATE_H
#define DDXVIDEO_GRABBER_STATE_H

#include "camera.h"
#include "controls.h"
#include "convert.h"
#include "frame_count.h"
#include "program.h"

struct grabber {
    /* what to do */
    struct program program;
    const char *name; /* of the video item */
    long skip;
    bool stack;
    /* the camera */
    struct camera *camera;
    struct converter converter;
    struct count count;
    char state[256];  /* what was said last of it; "" while all is well */
    char reason[256]; /* why it could not be opened last, and since when: */
    int64_t since;
    int64_t retry;      /* when to open it again */
    int64_t opened;     /* when it was opened last */
    int64_t silent;     /* ns that we looked in vain since the last frame, or since it was opened */
    int64_t last;       /* time of the last frame counted, 0 if none yet */
    uint64_t away;      /* frames counted since the camera went */
    bool back;          /* since it was opened: has it given a frame? */
    bool odd_times;     /* its times have been found useless */
    uint64_t lost_said; /* frames lost in the driver when that was said last */
    int64_t lost_when;
    struct controls controls;
    /* the store */
    DDX_STORE_ID *id;
    DDX_STATS_BOOK *book;
    DDX_STORE_ITEM *video, *counter;
    struct ddxvideo_geometry geometry; /* of the result */
    struct ddxvideo_geometry created;  /* what the item was made for */
    int64_t create;                    /* when to try again to create it */
    DDX_STORE_ITEM *parameters;
    DDX_REQUESTS *requests;
    bool changed;     /* a control, since the parameters were written */
    int64_t settings; /* when to write them again, and to try again to create their items */
};

#endif
