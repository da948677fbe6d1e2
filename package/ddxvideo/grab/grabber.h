/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Grabs from a camera into the store; a camera that fails or is unplugged is opened again. */
#ifndef DDXVIDEO_GRABBER_H
#define DDXVIDEO_GRABBER_H

#include "camera.h"
#include "controls.h"
#include "convert.h"
#include "frame_count.h"
#include "program.h"

/* A grabber's settings and state: camera, frames, items. */
struct grabber {
    /* settings: */
    struct program program;
    const char *name; /* of the video item */
    long skip;
    bool stack;
    /* camera: */
    struct camera *camera;
    struct converter converter;
    struct count count;
    char state[256];  /* last reported state; "" while all is well */
    char reason[256]; /* why it cannot be opened; since when: */
    int64_t since;
    int64_t retry;      /* when to open it again */
    int64_t opened;     /* time of the last open() */
    int64_t silent;     /* ns of waiting in vain since the last frame, or since open() */
    int64_t last;       /* time of the last frame counted, 0 if none yet */
    uint64_t away;      /* frames counted while the camera is away */
    bool back;          /* a frame has come since open() */
    bool odd_times;     /* its times are not of this machine's clock */
    uint64_t lost_said; /* frames lost in the driver at the last line about them */
    int64_t lost_when;
    struct controls controls;
    /* store: */
    DDX_STORE_ID *id;
    DDX_STATS_BOOK *book;
    DDX_STORE_ITEM *video, *counter;
    struct ddxvideo_geometry geometry; /* of the result */
    struct ddxvideo_geometry created;  /* of the item */
    int64_t create;                    /* time of the next attempt to create it */
    DDX_STORE_ITEM *parameters;
    DDX_REQUESTS *requests;
    bool changed;     /* a control has changed since the parameters were written */
    int64_t settings; /* when to write them, or to create their items, again */
};

/* Grab until a stop is requested. Returns the exit status. */
int grabber_run(struct grabber *grabber);

#endif
