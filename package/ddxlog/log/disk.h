/* SPDX-License-Identifier: GPL-2.0-or-later */
/* State shared by the logger's threads, and the thread that writes the files. */
#ifndef DDXLOG_DISK_H
#define DDXLOG_DISK_H

#include <ddx_stats.h>
#include <form.h>
#include <limits.h>
#include <mcap.h>
#include <output.h>
#include <program.h>
#include <stdatomic.h>

#include "config.h"
#include "queue.h"

/* Reasons of loss, in the order of the names given to ddx_stats_open(). */
enum { LOST_STORE, LOST_QUEUE, LOST_WRITE };

struct item;

/*
 * State shared by the logger's threads. A layout of an item, with its ids in the current file. Never freed before the
 * exit, since the queue points to it.
 */
struct channel {
    struct channel *next; /* of the item */
    const struct item *item;
    struct form *form;
    /* the disk thread's: */
    uint64_t file;
    uint16_t id, schema;
};

enum item_state {
    ITEM_ABSENT, /* finder's: not in the store, or closed */
    ITEM_FOUND,  /* main thread's: opened, its first value is held */
    ITEM_READ,   /* main thread's */
    ITEM_LEAVE   /* main thread's: it has no writer; to be closed, so that its type may change */
};

struct item {
    char name[DDX_NAME_MAX + 1];
    const struct config_rule *rule;
    _Atomic(enum item_state) state; /* decides which thread owns the following fields */
    DDX_STORE_ITEM *handle;
    struct ddx_frame first; /* ITEM_FOUND: the held value; sequence 0 if there was none */
    bool awaited;           /* log from its first value on: the item was new, or had no value, when first seen */
    bool known;             /* it was read before: values written since `sequence` are missed */
    unsigned kept;
    /* the main thread's: */
    uint64_t sequence;
    int64_t due; /* with a rate: earliest time of the next value */
    uint32_t layout;
    struct channel *channel, *channels;
    bool refused; /* a line says that its values are lost */
    /* the disk thread's: the newest value, with which the next file begins */
    struct {
        unsigned char *data;
        size_t size, room;
        struct channel *channel;
        uint64_t sequence;
        int64_t time;
    } last;
    uint64_t reported; /* losses, when they were last written to the file */
    uint64_t unsafe;   /* part of `out` since the file was last flushed to the disk */
    /* the finder's: */
    int64_t alone;             /* time since when it has no writer; 0: it has one */
    uint64_t listed;           /* its sequence in the previous list */
    _Atomic unsigned keep;     /* frames that the store should keep for the logger */
    _Atomic uint64_t consumed; /* as `sequence`, for the finder */
    /* Counters of wanted values; `skipped` were left out by the rate. */
    _Atomic uint64_t in, out, skipped, lost[3];
};

#define ITEMS_MAX 1024

struct disk;

struct logger {
    struct program program;
    struct config config;
    int64_t begin; /* values written before this are logged with the time at which they were read */
    DDX_STATS_BOOK *book;
    DDX_STORE_ID *id;
    struct queue queue;
    struct disk *disk;
    struct item *items[ITEMS_MAX];
    _Atomic unsigned item_count;
    atomic_bool stopping;
    int status;
};

#define DISK_SCHEMAS_MAX 4096

/* The files of a log, written one after the other by the disk's thread. */
struct pending {
    struct item *item;
    int64_t time; /* since when the value waits */
};

struct disk {
    struct logger *logger;
    pthread_t thread;
    _Atomic int error;
    struct output output;
    struct pending *pending;
    size_t pending_count, pending_room;
    /* the current file: */
    uint64_t file; /* its number, from 1 */
    char path[PATH_MAX];
    int fd;
    struct mcap_writer *writer; /* NULL: no file is open */
    uint64_t safe;              /* bytes known to be on the disk */
    bool unsafe;                /* a flush has failed: even if a later one succeeds, bytes above `safe` may be lost */
    int64_t begin;              /* CLOCK_MONOTONIC */
    int64_t wall_offset;        /* wall time less CLOCK_MONOTONIC, when the file began */
    uint16_t channels, schemas, losses;         /* ids in use; id of the channel for losses */
    const struct form *forms[DISK_SCHEMAS_MAX]; /* the file's schemas, by id */
    uint32_t reports;                           /* number of messages about losses */
};

/* Start the thread. 0, or -errno after a line. */
int disk_start(struct logger *logger);
/* 0, or -errno: writing has failed, and all later values are lost. */
int disk_error(const struct disk *disk);
/* Write the queued values and finish the file. 0, or -errno after a line. */
int disk_stop(struct disk *disk);

#endif
