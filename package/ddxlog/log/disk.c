/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The disk's thread: writes messages from the queue to files, one file after the other. */
#include "disk.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "file.h"

#define FLUSH_NS INT64_C(1000000000) /* a power cut loses the values of this time at most */
#define LAST_MAX (64u << 10)         /* larger values are not repeated in the next file */

/* Count the values of the current chunk, once it is written, or has failed. */
static void account(struct disk *disk, int error) {
    int64_t now = ddx_time_now();

    for (size_t i = 0; i < disk->pending_count; i++) {
        struct item *item = disk->pending[i].item;

        if (error) {
            atomic_fetch_add(&item->lost[LOST_WRITE], 1);
            ddx_stats_lost(disk->logger->book, LOST_WRITE, 1);
        } else {
            atomic_fetch_add(&item->out, 1);
            item->unsafe++;
            ddx_stats_out(disk->logger->book, 1, now - disk->pending[i].time);
        }
    }
    disk->pending_count = 0;
}

static bool note(struct disk *disk, struct item *item, int64_t time) {
    if (disk->pending_count == disk->pending_room) {
        size_t room = disk->pending_room ? disk->pending_room * 2 : 1024;
        struct pending *more = realloc(disk->pending, room * sizeof *more);

        if (!more)
            return false;
        disk->pending = more;
        disk->pending_room = room;
    }
    disk->pending[disk->pending_count++] = (struct pending){item, time};
    return true;
}

static void fail(struct disk *disk, int error) {
    say("%s: logging stopped, %s; earlier values are readable%s", *disk->path ? disk->path : disk->output.place,
        strerror(-error), error == -ENOSPC || error == -EDQUOT ? ", make room and start again" : "");
    account(disk, error);
    file_give_up(disk);
    atomic_store(&disk->error, error);
}

/* Write the current chunk. */
static void flush(struct disk *disk) {
    int error = disk->writer ? mcap_flush(disk->writer) : 0;

    if (error)
        fail(disk, error);
    else
        account(disk, 0);
}

/* If the file is large or old enough, finish it; the next value begins another. */
static void turn_page(struct disk *disk) {
    if (!disk->writer || (mcap_written(disk->writer) < disk->logger->config.segment &&
                          ddx_time_now() - disk->begin < disk->logger->config.age))
        return;
    int error = file_end(disk);
    if (error)
        fail(disk, error);
}

static void remember(struct item *item, const struct queue_entry *entry) {
    if (entry->size > LAST_MAX) {
        item->last.size = 0;
        return;
    }
    if (entry->size > item->last.room) {
        unsigned char *more = realloc(item->last.data, entry->size);

        if (!more)
            return;
        item->last.data = more;
        item->last.room = entry->size;
    }
    memcpy(item->last.data, entry->data, entry->size);
    item->last.size = entry->size;
    item->last.channel = entry->channel;
    item->last.sequence = entry->sequence;
    item->last.time = entry->time;
}

static void take(struct disk *disk, const struct queue_entry *entry) {
    if (disk->writer && mcap_pending(disk->writer) + entry->size > MCAP_MESSAGE_MAX)
        flush(disk); /* keep the chunk within the limit of readers */
    bool noted = note(disk, entry->item, entry->logged);
    int error = atomic_load(&disk->error);

    if (!error && !disk->writer && (error = file_begin(disk, entry->logged)))
        fail(disk, error); /* counts the pending values, this one included */
    else if (error)
        account(disk, error);
    else if (!noted || !file_put(disk, entry->channel, entry->sequence, entry->time, entry->logged, entry->data,
                                 entry->size)) {
        disk->pending_count -= noted;
        atomic_fetch_add(&entry->item->lost[LOST_WRITE], 1);
        ddx_stats_lost(disk->logger->book, LOST_WRITE, 1);
    }
    remember(entry->item, entry);
    if (disk->writer && mcap_pending(disk->writer) >= MCAP_CHUNK_USUAL) {
        flush(disk);
        turn_page(disk);
    }
}

/* Once a second. */
static void settle(struct disk *disk) {
    if (!disk->writer || atomic_load(&disk->error))
        return;
    file_put_losses(disk, false);
    flush(disk);
    int error = disk->writer ? file_sync(disk) : 0;
    if (error)
        fail(disk, error);
    turn_page(disk);
}

static void *write_files(void *argument) {
    struct disk *disk = argument;
    bool end = false;
    int64_t next = ddx_time_now() + FLUSH_NS;

    program_thread_signals();
    program_thread_ordinary();
    while (!end) {
        struct queue_entry *entry = queue_next(&disk->logger->queue, next, &end);

        if (entry) {
            take(disk, entry);
            queue_take(&disk->logger->queue);
        }
        if (ddx_time_now() >= next) {
            settle(disk);
            next = ddx_time_now() + FLUSH_NS;
        }
    }
    flush(disk);
    int error = disk->writer ? file_end(disk) : 0;
    if (error)
        fail(disk, error);
    return NULL;
}

int disk_start(struct logger *logger) {
    struct disk *disk = calloc(1, sizeof *disk);
    const char *folder = logger->config.folder;

    if (!disk)
        return -ENOMEM;
    disk->logger = logger;
    disk->fd = -1;
    int error = mkdir(folder, 02775) && errno != EEXIST ? -errno : 0;
    if (!error)
        error = output_check(&disk->output, folder, logger->program.instance, "mcap");
    if (!error && !disk->output.is_folder)
        error = -ENOTDIR;
    if (!error)
        error = -pthread_create(&disk->thread, NULL, write_files, disk);
    if (error) {
        say("output %s: %s; name a folder that can be written", folder, strerror(-error));
        free(disk);
        return error;
    }
    logger->disk = disk;
    return 0;
}

int disk_error(const struct disk *disk) {
    return atomic_load(&disk->error);
}

int disk_stop(struct disk *disk) {
    queue_close(&disk->logger->queue);
    pthread_join(disk->thread, NULL);
    int error = atomic_load(&disk->error);
    free(disk->pending);
    free(disk);
    return error;
}
