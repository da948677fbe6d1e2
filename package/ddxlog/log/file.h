/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What the disk's thread works on: one file of a log after the other. */
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
    /* the present file: */
    uint64_t file; /* its number, from 1 */
    char path[PATH_MAX];
    int fd;
    struct mcap_writer *writer; /* NULL: there is none */
    uint64_t safe;              /* bytes that the disk has for certain */
    bool unsafe;                /* a flush has failed; no later one proves what was written since the last good one */
    int64_t begin;              /* CLOCK_MONOTONIC */
    int64_t wall_offset;        /* wall time less CLOCK_MONOTONIC, when it began */
    uint16_t channels, schemas, losses; /* ids in use; of the channel for losses */
    const struct form *forms[DISK_SCHEMAS_MAX]; /* by id, of those that are in the file */
    uint32_t told;                              /* messages about losses */
};

/* Those that return int: 0 or -errno. */

/* A new file, whose first value is of that time, with what is known of the items. */
int file_begin(struct disk *disk, int64_t begin);
/* A message into the present chunk. False: no memory. */
bool file_put(struct disk *disk, struct channel *channel, uint64_t sequence, int64_t time, int64_t logged,
              const void *data, size_t size);
/* A message for each item of which something was lost since the last time, or for each item. */
void file_put_losses(struct disk *disk, bool all);
/* All that was written is on the disk. */
int file_sync(struct disk *disk);
/* Counters, summary, end. There is no file then. */
int file_end(struct disk *disk);
/* What the disk may not have is lost: values that were counted as logged, too. The file is cut there, and left so. */
void file_give_up(struct disk *disk);

#endif
