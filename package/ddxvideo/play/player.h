/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Shows the newest frame of a video item on the screen. */
#ifndef DDXVIDEO_PLAY_PLAYER_H
#define DDXVIDEO_PLAY_PLAYER_H

#include "as_420.h"
#include "caption.h"
#include "layout.h"
#include "monitor.h"
#include "paint.h"
#include "program.h"
#include "still.h"

/* Set by main(); all others are 0 at first. */
struct player {
    struct program program;
    const char *name;
    int field; /* from 0, or LAYOUT_ALL */
    enum layout_fit fit;
    bool text;
    struct monitor monitor;

    struct watch watch;
    DDX_STATS_BOOK *book;
    DDX_STORE_ID *id; /* NULL: no store yet */
    DDX_STORE_ITEM *item;
    struct painter painter;
    struct as_420 as;
    struct still still;  /* the newest picture, kept when the next one is late */
    bool kept;           /* the kept picture is that of `sequence` */
    uint64_t sequence;   /* of the newest picture; 0: none yet */
    int64_t written;     /* its time, ns; before the first picture: the start of the player */
    uint64_t first;      /* the first sequence for the rate, and the time of its write */
    int64_t counted;
    double rate;
    const char *trouble; /* why the item's picture cannot be shown; NULL: it can */
    struct caption shown; /* on the screen */
};

/* Run until a stop is requested. Returns the exit status. */
int player_run(struct player *player);

#endif
