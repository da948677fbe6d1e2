/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_PLAYER_H
#define DDXVIDEO_PLAYER_H

#include "program.h"
#include "schedule.h"
#include "y4m.h"

struct player {
    /* settings: */
    struct program program; /* its argument is the file */
    const char *name;
    bool loop;
    long readers;
    int format;        /* enum ddx_video_format of the pictures in the item */
    const char *clock; /* name of the DDX_REPLAY_CLOCK to follow; NULL: start at once */
    struct schedule_speed speed;
    /* state: */
    struct y4m_reader file;
    struct schedule schedule;
    struct schedule_pace pace;
    DDX_STATS_BOOK *book;
    DDX_STORE_ID *id;
    DDX_STORE_ITEM *video, *counter, *parameters;
    int64_t begin;     /* when the first frame was due, ns; with a clock it may be before the program's start */
    bool begun;
    bool patient;      /* waits for readers, which set the pace */
    bool cut;          /* a line has reported that the file ends within a frame */
    int64_t not_before; /* with a clock: earlier frames are left out */
    uint64_t frame;    /* number of the next frame */
    int64_t published; /* time of the last frame; before the first one, of the start */
};

/* Play the file. Returns the exit status. */
int player_run(struct player *player);

#endif
