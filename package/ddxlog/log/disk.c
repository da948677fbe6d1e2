/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The disk's thread: writes messages from the queue to files, one file after the other. */
#include "disk.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "ddx_time.h"

/* Functions that return int return 0 or -errno. */

/* ---- Files ---- */

/* One file of a log. */

#define LOSSES_TOPIC "ddxlog/lost"
#define NUMBER "{\"type\":\"integer\"}"
static const char losses_schema[] =
    "{\"type\":\"object\",\"properties\":{\"item\":{\"type\":\"string\"},\"in\":" NUMBER ",\"out\":" NUMBER
    ",\"skipped\":" NUMBER ",\"lost\":{\"type\":\"object\",\"properties\":{\"store\":" NUMBER ",\"queue\":" NUMBER
    ",\"write\":" NUMBER "}}}}";

static int64_t wall_now(void) {
    struct timespec wall;

    clock_gettime(CLOCK_REALTIME, &wall);
    return wall.tv_sec * SECOND + wall.tv_nsec;
}

/* A time of CLOCK_MONOTONIC as wall time, as in the file; also for times before CLOCK_MONOTONIC's start. */
static uint64_t file_time(const struct disk *disk, int64_t time) {
    return (uint64_t)time + (uint64_t)disk->wall_offset;
}

/* Identifies the boot that CLOCK_MONOTONIC counts from: recordings of the same boot have comparable times. */
static void boot_id(char id[40]) {
    FILE *file = fopen("/proc/sys/kernel/random/boot_id", "re");

    if (!file || !fgets(id, 40, file))
        strcpy(id, "");
    id[strcspn(id, "\n")] = 0;
    if (file)
        fclose(file);
}

static void put_times(struct disk *disk) {
    char offset[24], monotonic[24], boot[40];

    snprintf(offset, sizeof offset, "%" PRId64, disk->wall_offset);
    snprintf(monotonic, sizeof monotonic, "%" PRId64, disk->begin);
    boot_id(boot);
    const struct mcap_pair pairs[] = {{"instance", disk->logger->program.instance},
                                      {"wall_offset_ns", offset},
                                      {"begin_monotonic_ns", monotonic},
                                      {"boot_id", boot},
                                      {NULL, NULL}};
    mcap_put_metadata(disk->writer, "ddxlog", pairs);
}

static void put_losses_channel(struct disk *disk) {
    const struct mcap_schema schema = {.id = ++disk->schemas,
                                       .name = "ddxlog.lost",
                                       .encoding = "jsonschema",
                                       .data = (const unsigned char *)losses_schema,
                                       .size = strlen(losses_schema)};
    const struct mcap_channel channel = {
        .id = disk->losses = ++disk->channels, .schema = schema.id, .topic = LOSSES_TOPIC, .encoding = "json"};

    disk->forms[schema.id] = NULL;
    mcap_put_schema(disk->writer, &schema);
    mcap_put_channel(disk->writer, &channel);
}

static void put_schema(struct disk *disk, struct channel *channel) {
    const struct form *form = channel->form;

    for (uint16_t id = 1; id <= disk->schemas && id < DISK_SCHEMAS_MAX; id++)
        if (disk->forms[id] && !strcmp(disk->forms[id]->schema_name, form->schema_name) &&
            !strcmp(disk->forms[id]->schema, form->schema)) {
            channel->schema = id;
            return;
        }
    const struct mcap_schema schema = {.id = channel->schema = ++disk->schemas,
                                       .name = form->schema_name,
                                       .encoding = FORM_SCHEMA_ENCODING,
                                       .data = (const unsigned char *)form->schema,
                                       .size = strlen(form->schema)};
    mcap_put_schema(disk->writer, &schema);
    if (schema.id < DISK_SCHEMAS_MAX)
        disk->forms[schema.id] = form;
}

static void put_channel(struct disk *disk, struct channel *channel, const char *topic) {
    const struct form *form = channel->form;

    put_schema(disk, channel);
    const struct mcap_pair pairs[] = {
        {"ddx.type", form->type}, {"ddx.declaration", form->declaration}, {"ddx.extents", form->extents}, {NULL, NULL}};
    const struct mcap_channel record = {.id = channel->id = ++disk->channels,
                                        .schema = channel->schema,
                                        .topic = topic,
                                        .encoding = FORM_ENCODING,
                                        .metadata = pairs};
    mcap_put_channel(disk->writer, &record);
    channel->file = disk->file;
}

/* Add a message to the current chunk. False: no memory. */
static bool file_put(struct disk *disk, struct channel *channel, uint64_t sequence, int64_t time, int64_t logged,
                     const void *data, size_t size) {
    if (channel->file != disk->file) {
        if (disk->channels == UINT16_MAX)
            return false;
        put_channel(disk, channel, channel->item->name);
    }
    const struct mcap_message message = {.channel = channel->id,
                                         .sequence = (uint32_t)sequence,
                                         .log_time = file_time(disk, logged),
                                         .publish_time = file_time(disk, time),
                                         .size = size};
    unsigned char *to = mcap_put_message_space(disk->writer, &message);
    if (to)
        memcpy(to, data, size);
    return to;
}

/* Begin the file with the newest value of each item: otherwise it might lack items that are rarely written. */
static void put_last_values(struct disk *disk) {
    unsigned count = atomic_load(&disk->logger->item_count);

    for (unsigned i = 0; i < count; i++) {
        const struct item *item = disk->logger->items[i];

        if (mcap_pending(disk->writer) >= MCAP_CHUNK_USUAL)
            mcap_flush(disk->writer); /* an error is kept in the writer, and returned by the last flush */
        if (item->last.size)
            file_put(disk, item->last.channel, item->last.sequence, item->last.time, disk->begin, item->last.data,
                     item->last.size);
    }
}

/* Delete older files until there is room for the next one. */
static void make_room(const struct disk *disk) {
    const struct config *config = &disk->logger->config;
    int error = config->keep ? output_keep(&disk->output, config->keep - config->segment) : 0;

    if (error)
        say("%s: an older log cannot be deleted: %s", disk->output.place, strerror(-error));
}

/* Begin a new file, whose first value is of time `begin`, with the newest values of all items. */
static int file_begin(struct disk *disk, int64_t begin) {
    make_room(disk);
    disk->fd = output_open(&disk->output, disk->path);
    if (disk->fd < 0)
        return disk->fd;
    flock(disk->fd, LOCK_EX | LOCK_NB); /* locks out `ddxlog -recover` */
    disk->writer = mcap_writer_new(disk->fd);
    if (!disk->writer)
        return -ENOMEM;
    disk->file++;
    disk->channels = disk->schemas = 0;
    disk->begin = begin;
    disk->safe = 0;
    disk->wall_offset = wall_now() - ddx_time_now();
    put_times(disk);
    put_losses_channel(disk);
    put_last_values(disk);
    say("logging to %s", disk->path);
    int error = mcap_flush(disk->writer);
    return error ? error : output_sync(&disk->output);
}

/* An item's name for JSON: quotes, backslashes and control characters become question marks. */
static void printable(const char *name, char out[DDX_NAME_MAX + 1]) {
    size_t i = 0;

    for (; name[i]; i++)
        out[i] = (unsigned char)name[i] < ' ' || name[i] == '"' || name[i] == '\\' ? '?' : name[i];
    out[i] = 0;
}

/* Add a message for each item (`all`), or for each item with new losses. */
static void file_put_losses(struct disk *disk, bool all) {
    unsigned count = atomic_load(&disk->logger->item_count);

    for (unsigned i = 0; i < count; i++) {
        struct item *item = disk->logger->items[i];
        uint64_t in = atomic_load(&item->in), out = atomic_load(&item->out), skipped = atomic_load(&item->skipped);
        uint64_t lost[3], sum = 0;

        for (int k = 0; k < 3; k++)
            sum += lost[k] = atomic_load(&item->lost[k]);
        if (!all && sum == item->reported)
            continue;
        item->reported = sum;
        char text[400], name[DDX_NAME_MAX + 1];
        printable(item->name, name);
        int size = snprintf(text, sizeof text,
                            "{\"item\":\"%s\",\"in\":%" PRIu64 ",\"out\":%" PRIu64 ",\"skipped\":%" PRIu64
                            ",\"lost\":{\"store\":%" PRIu64 ",\"queue\":%" PRIu64 ",\"write\":%" PRIu64 "}}",
                            name, in, out, skipped, lost[LOST_STORE], lost[LOST_QUEUE], lost[LOST_WRITE]);
        uint64_t now = file_time(disk, ddx_time_now());
        const struct mcap_message message = {.channel = disk->losses,
                                             .sequence = ++disk->reports,
                                             .log_time = now,
                                             .publish_time = now,
                                             .data = (const unsigned char *)text,
                                             .size = (size_t)size};
        mcap_put_message(disk->writer, &message);
    }
}

static void close_file(struct disk *disk) {
    mcap_writer_free(disk->writer);
    disk->writer = NULL;
    if (disk->fd >= 0)
        close(disk->fd);
    disk->fd = -1;
}

/* Flush the file to the disk. */
static int file_sync(struct disk *disk) {
    unsigned count = atomic_load(&disk->logger->item_count);

    if (fdatasync(disk->fd)) {
        disk->unsafe = true;
        return -errno;
    }
    disk->safe = mcap_written(disk->writer);
    for (unsigned i = 0; i < count; i++)
        disk->logger->items[i]->unsafe = 0;
    return 0;
}

/* Write counters and summary, and close the file. */
static int file_end(struct disk *disk) {
    file_put_losses(disk, true);
    int error = mcap_finish(disk->writer);
    if (!error)
        error = file_sync(disk);
    if (!error)
        close_file(disk);
    return error;
}

/* Count the values logged since the last good flush as lost. */
static void take_back(struct disk *disk) {
    unsigned count = atomic_load(&disk->logger->item_count);

    for (unsigned i = 0; i < count; i++) {
        struct item *item = disk->logger->items[i];

        atomic_fetch_sub(&item->out, item->unsafe);
        atomic_fetch_add(&item->lost[LOST_WRITE], item->unsafe);
        ddx_stats_take_back(disk->logger->book, LOST_WRITE, item->unsafe);
        item->unsafe = 0;
    }
}

/* After an error: count values that may not be on the disk as lost, truncate the file after `safe`, and close it. */
static void file_give_up(struct disk *disk) {
    if (disk->fd >= 0 && disk->writer && !disk->unsafe)
        file_sync(disk); /* only a write failed: earlier records may still reach the disk */
    take_back(disk);
    if (disk->fd >= 0 && !disk->safe)
        unlink(disk->path); /* the file has no record */
    else if (disk->fd >= 0 && (ftruncate(disk->fd, (off_t)disk->safe) || fdatasync(disk->fd)))
        say("%s: cannot be truncated after its last whole record: %s", disk->path, strerror(errno));
    close_file(disk);
}

/* ---- The thread ---- */

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

static void take_entry(struct disk *disk, const struct queue_entry *entry) {
    if (disk->writer && mcap_pending(disk->writer) + entry->size > MCAP_MESSAGE_MAX)
        flush(disk); /* keep the chunk within the limit of readers */
    bool noted = note(disk, entry->item, entry->logged);
    int error = atomic_load(&disk->error);

    if (!error && !disk->writer && (error = file_begin(disk, entry->logged)))
        fail(disk, error); /* counts the pending values, this one included */
    else if (error)
        account(disk, error);
    else if (!noted ||
             !file_put(disk, entry->channel, entry->sequence, entry->time, entry->logged, entry->data, entry->size)) {
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
            take_entry(disk, entry);
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
