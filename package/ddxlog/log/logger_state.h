/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What the threads of the logger share. */
#ifndef DDXLOG_LOGGER_STATE_H
#define DDXLOG_LOGGER_STATE_H

#include <ddx_stats.h>
#include <form.h>
#include <program.h>
#include <stdatomic.h>

#include "config.h"
#include "queue.h"

/* Reasons of loss, in the order of the names given to ddx_stats_open(). */
enum { LOST_STORE, LOST_QUEUE, LOST_WRITE };

struct item;

/* A layout of an item, with what it is called in the present file. Kept until the end, since the queue points to it. */
struct channel {
    struct channel *next; /* of the item */
    const struct item *item;
    struct form *form;
    /* the disk thread's: */
    uint64_t file;
    uint16_t id, schema;
};

enum item_state {
    ITEM_ABSENT, /* finder: not there, or given back */
    ITEM_FOUND,  /* main thread: opened, its newest value is held */
    ITEM_READ,   /* main thread */
    ITEM_LEAVE   /* main thread: it has no writer; give it back, so that its type may change */
};

struct item {
    char name[DDX_NAME_MAX + 1];
    const struct config_rule *rule;
    _Atomic(enum item_state) state; /* says whose the following are */
    DDX_STORE_ITEM *handle;
    struct ddx_frame first; /* ITEM_FOUND: the value that is held; sequence 0 if there was none */
    bool awaited;           /* its values from the first on are wanted: when we saw it first it was new, or had none */
    bool known;             /* it was read before: what was written since `sequence` is missed */
    unsigned kept;
    /* the main thread's: */
    uint64_t sequence;
    int64_t due; /* with a rate: not before */
    uint32_t layout;
    struct channel *channel, *channels;
    bool refused; /* said that there was no room for its values */
    /* the disk thread's: the newest value, with which the next file begins */
    struct {
        unsigned char *data;
        size_t size, room;
        struct channel *channel;
        uint64_t sequence;
        int64_t time;
    } last;
    uint64_t told; /* losses, when they were last written to the file */
    uint64_t unsafe; /* of `out`, since the file was last flushed to the disk */
    /* the finder's: */
    int64_t alone;             /* since when it has no writer; 0: it has one */
    uint64_t listed;           /* its sequence when we last looked */
    _Atomic unsigned keep;     /* frames that it should keep for us */
    _Atomic uint64_t consumed; /* as `sequence`, for the finder */
    /* Counters: of values that were wanted; `skipped` were not, by the rate. */
    _Atomic uint64_t in, out, skipped, lost[3];
};

#define ITEMS_MAX 1024

struct disk;

struct logger {
    struct program program;
    const char *config_path;
    struct config config;
    int64_t begin; /* what was written before is logged as of when we saw it */
    DDX_STATS_BOOK *book;
    DDX_STORE_ID *id;
    struct queue queue;
    struct disk *disk;
    struct item *items[ITEMS_MAX];
    _Atomic unsigned item_count;
    atomic_bool stopping;
    int status;
};

#endif
