/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The newest frame of a video item, on the screen. */
#ifndef DDXVIDEO_PLAY_PLAYER_H
#define DDXVIDEO_PLAY_PLAYER_H

#include "as_420.h"
#include "caption.h"
#include "layout.h"
#include "monitor.h"
#include "paint.h"
#include "program.h"
#include "still.h"

/* As main() sets it; the rest is 0 at first. */
struct player {
    struct program program;
    const char *name;
    int field; /* from 0, or LAYOUT_ALL */
    enum layout_fit fit;
    bool text;
    struct monitor monitor;

    struct watch watch;
    DDX_STATS_BOOK *book;
    DDX_STORE_ID *id; /* NULL: no store was there yet */
    DDX_STORE_ITEM *item;
    struct painter painter;
    struct as_420 as;
    struct still still;  /* the newest picture, as soon as the next one does not come at once */
    bool kept;           /* it is that of `sequence` */
    uint64_t sequence;   /* of the newest picture; 0: none yet */
    int64_t written;     /* when, ns; before the first one: when the player began */
    uint64_t first;      /* sequence that the rate is counted from, and when that was written */
    int64_t counted;
    double rate;
    const char *trouble; /* why no picture can be had though there is one; NULL: none */
    struct caption shown; /* on the screen */
};

/* Until told to stop; the exit status. */
int player_run(struct player *player);

#endif
