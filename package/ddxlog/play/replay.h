/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Replay of a log into the store. */
#ifndef DDXLOG_REPLAY_H
#define DDXLOG_REPLAY_H

#include <ddx_stats.h>
#include <mcap.h>
#include <program.h>
#include <schedule.h>

struct replay_item;

/* Settings and state of a replay. */
struct replay {
    struct program program;
    /* settings */
    const char *path;
    const char *prefix;
    const char *except; /* patterns of items that are not replayed, separated by commas; NULL: none */
    const char *clock;  /* the name of a DDX_REPLAY_CLOCK, or NULL */
    const char *tick;   /* a step is everything up to the next value of this item; NULL: one message */
    bool loop, step;
    long readers;
    bool patient; /* wait for readers before each value (-rate 0) */
    struct schedule_speed speed;
    int64_t from, to; /* ns from the first message; to: INT64_MAX if not given */
    /* state */
    DDX_STATS_BOOK *book;
    DDX_STORE_ID *id;
    struct mcap_reader *reader;
    struct replay_item *items;
    DDX_STORE_ITEM *clock_item;
    uint64_t origin;     /* log time that is replayed ... */
    int64_t begin;       /* ... at this time, CLOCK_MONOTONIC */
    int64_t wall_offset; /* log time less CLOCK_MONOTONIC of the recording machine */
    int status;
};

/* Replay; returns the program's exit status. */
int replay_run(struct replay *replay);

#endif
