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
    struct schedule_speed speed;
    /* how it stands */
    struct y4m_reader file;
    struct schedule schedule;
    DDX_STATS_BOOK *book;
    DDX_STORE_ITEM *video, *counter, *parameters;
    int64_t begin;     /* when the first frame was due, ns */
    uint64_t frame;    /* number of the next frame */
    int64_t published; /* when the last frame was */
};

/* Play the file; returns the program's exit status. */
int player_run(struct player *player);

#endif
