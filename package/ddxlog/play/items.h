/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The items that a replay writes. */
#ifndef DDXLOG_ITEMS_H
#define DDXLOG_ITEMS_H

#include <ddx_stats.h>
#include <form.h>
#include <mcap.h>
#include <program.h>
#include <schedule.h>

struct replay_item; /* items.h */

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

/* One for each topic; its layout may change from channel to channel. */
struct replay_item {
    struct replay_item *next;
    const char *topic;
    char name[DDX_NAME_MAX + 1];
    DDX_STORE_ITEM *handle;
    struct form *form; /* of the item's current layout */
    uint16_t channel;  /* the channel that has this layout; 0: none */
    bool refused;      /* reported and left out, for example because another program writes it */
};

/* Create all items of the log. Returns their number. */
unsigned items_create(struct replay *replay);
void items_free(struct replay *replay);

/*
 * Write a message with this time. Returns its item. NULL, *error 0: not written by ddxlog, or excepted. NULL, *error
 * -errno: writing failed; reported once for each item.
 */
struct replay_item *items_write(struct replay *replay, const struct mcap_message *message, int64_t time, int *error);

/* The least number of readers that an item has. */
int items_readers(const struct replay *replay);

#endif
