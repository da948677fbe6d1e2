/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_PLAYER_H
#define DDXVIDEO_PLAYER_H

#include "program.h"
#include "schedule.h"
#include "y4m.h"

struct player {
    /* what to do */
    struct program program; /* its argument is the file */
    const char *name;
    bool loop;
    long readers;
    int format;        /* enum ddx_video_format of the pictures in the item */
    const char *clock; /* begins when this DDX_REPLAY_CLOCK says; NULL: at once */
    struct schedule_speed speed;
    /* how it stands */
    struct y4m_reader file;
    struct schedule schedule;
    struct schedule_pace pace;
    DDX_STATS_BOOK *book;
    DDX_STORE_ID *id;
    DDX_STORE_ITEM *video, *counter, *parameters;
    int64_t begin;     /* when the first frame was due, ns; may lie before we began to play */
    bool begun;
    bool patient;      /* waits for readers: has no other clock */
    bool cut;          /* said that the file ends within a frame */
    int64_t not_before; /* with a clock: frames that were due earlier are left out */
    uint64_t frame;    /* number of the next frame */
    int64_t published; /* when the last frame was; before the first one, when we began */
};

/* Play the file; returns the program's exit status. */
int player_run(struct player *player);

#endif
