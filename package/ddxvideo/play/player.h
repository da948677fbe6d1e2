/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Shows the newest frame of a video item on the screen. */
#ifndef DDXVIDEO_PLAY_PLAYER_H
#define DDXVIDEO_PLAY_PLAYER_H

#include <ddxvideo.h>
#include <stddef.h>
#include <stdint.h>

#include "paint.h"
#include "picture_convert.h"
#include "program.h"
#include "surface.h"
#include "watch.h"

/* A copy of a picture, which lasts longer than the frame in the store. All 0 at first: no picture. */
struct still {
    struct ddxvideo_picture picture; /* its planes are in: */
    unsigned char *bytes;
    size_t size;
};

/*
 * Opens the screen again and again; each reason why it cannot be used is reported once. `choice` is set, the rest 0 at
 * first.
 */
struct monitor {
    struct screen_choice choice;
    struct surface *surface; /* NULL: none now */
    int64_t tried;           /* time of the last attempt, ns of CLOCK_MONOTONIC */
    char said[256];          /* reason of the last failure */
};

struct caption {
    char line[2][128]; /* an empty line is left out */
};

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
    struct still still; /* the newest picture, kept when the next one is late */
    bool kept;          /* the kept picture is that of `sequence` */
    uint64_t sequence;  /* of the newest picture; 0: none yet */
    int64_t written;    /* its time, ns; before the first picture: the start of the player */
    uint64_t first;     /* the first sequence for the rate, and the time of its write */
    int64_t counted;
    double rate;
    const char *trouble;  /* why the item's picture cannot be shown; NULL: it can */
    struct caption shown; /* on the screen */
};

/* Run until a stop is requested. Returns the exit status. */
int player_run(struct player *player);

#endif
