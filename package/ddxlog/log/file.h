/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The files of a log, written one after the other by the disk's thread. */
#ifndef DDXLOG_FILE_H
#define DDXLOG_FILE_H

#include <limits.h>
#include <mcap.h>
#include <output.h>

#include "logger_state.h"

#define DISK_SCHEMAS_MAX 4096

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
    uint16_t channels, schemas, losses; /* ids in use; id of the channel for losses */
    const struct form *forms[DISK_SCHEMAS_MAX]; /* the file's schemas, by id */
    uint32_t told;                              /* number of messages about losses */
};

/* Functions that return int return 0 or -errno. */

/* Begin a new file, whose first value is of time `begin`, with the newest values of all items. */
int file_begin(struct disk *disk, int64_t begin);
/* Add a message to the current chunk. False: no memory. */
bool file_put(struct disk *disk, struct channel *channel, uint64_t sequence, int64_t time, int64_t logged,
              const void *data, size_t size);
/* Add a message for each item (`all`), or for each item with new losses. */
void file_put_losses(struct disk *disk, bool all);
/* Flush the file to the disk. */
int file_sync(struct disk *disk);
/* Write counters and summary, and close the file. */
int file_end(struct disk *disk);
/* After an error: count values that may not be on the disk as lost, truncate the file after `safe`, and close it. */
void file_give_up(struct disk *disk);

#endif
