/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "recover.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <output.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

struct copy {
    struct mcap_reader *reader;
    struct mcap_writer *writer;
    uint16_t *channel, *schema; /* new ids by old ones; 0: not copied yet */
    uint16_t channels, schemas;
    bool damaged_within;
};

static void copy_metadata(struct copy *copy, const struct recovery *recovery) {
    const struct mcap_pair *pairs;
    const char *name;
    char left_over[24], damaged[24];

    for (unsigned i = 0; (name = mcap_metadata_at(copy->reader, i, &pairs)); i++)
        mcap_put_metadata(copy->writer, name, pairs);
    snprintf(left_over, sizeof left_over, "%llu", (unsigned long long)recovery->state.left_over);
    snprintf(damaged, sizeof damaged, "%u", recovery->state.damaged);
    const struct mcap_pair own[] = {{"left_over_bytes", left_over}, {"damaged_chunks", damaged}, {NULL, NULL}};
    mcap_put_metadata(copy->writer, "ddxlog.recovered", own);
}

static uint16_t new_schema(struct copy *copy, uint16_t id) {
    const struct mcap_schema *old = mcap_schema(copy->reader, id);

    if (!old || copy->schema[id])
        return copy->schema[id];
    struct mcap_schema schema = *old;
    schema.id = copy->schema[id] = ++copy->schemas;
    mcap_put_schema(copy->writer, &schema);
    return schema.id;
}

/* 0: the channel was not declared. */
static uint16_t new_channel(struct copy *copy, uint16_t id) {
    const struct mcap_channel *old = mcap_channel(copy->reader, id);

    if (!old || copy->channel[id])
        return copy->channel[id];
    struct mcap_channel channel = *old;
    channel.schema = new_schema(copy, old->schema);
    channel.id = copy->channel[id] = ++copy->channels;
    mcap_put_channel(copy->writer, &channel);
    return channel.id;
}

/* Copy the messages of a chunk; flushed in between, so that a large chunk is not in memory twice. */
static int copy_messages(struct copy *copy, const struct mcap_message *messages, long count,
                         struct recovery *recovery) {
    for (long k = 0; k < count; k++) {
        struct mcap_message message = messages[k];
        size_t pending = mcap_pending(copy->writer);

        message.channel = new_channel(copy, message.channel);
        if (!message.channel)
            continue;
        if (pending >= MCAP_CHUNK_USUAL || pending + message.size > MCAP_MESSAGE_MAX) {
            int error = mcap_flush(copy->writer);

            if (error)
                return error;
        }
        mcap_put_message(copy->writer, &message);
        recovery->messages++;
    }
    return mcap_flush(copy->writer);
}

static int copy_chunks(struct copy *copy, const atomic_bool *stop, struct recovery *recovery) {
    bool damaged = false;

    for (unsigned i = 0; i < recovery->state.chunks; i++) {
        const struct mcap_message *messages;
        long count = mcap_chunk(copy->reader, i, &messages);

        if (count < 0 && count != -EBADMSG)
            return (int)count;
        /* A damaged last chunk is usual after a power cut; a damaged chunk with good ones after it is not. */
        copy->damaged_within |= count >= 0 && damaged;
        damaged |= count < 0;
        if (*stop)
            return -ECANCELED;
        int error = copy_messages(copy, messages, count, recovery);
        if (error)
            return error;
    }
    return 0;
}

static int copy_all(struct copy *copy, const atomic_bool *stop, struct recovery *recovery) {
    copy->channel = calloc(2 * 65536, sizeof *copy->channel);
    if (!copy->channel || !copy->writer)
        return -ENOMEM;
    copy->schema = copy->channel + 65536;
    int error = copy_chunks(copy, stop, recovery);
    recovery->state = mcap_state(copy->reader);
    copy->damaged_within |= recovery->state.refused; /* not caused by a power cut: another program may read them */
    copy_metadata(copy, recovery);
    return error ? error : mcap_finish(copy->writer);
}

/* Replace the old file by the complete copy. */
static int replace(const char *path, const char *copy, bool keep, struct recovery *recovery) {
    char damaged[PATH_MAX];

    if (keep) {
        if (snprintf(damaged, sizeof damaged, "%s.damaged", path) >= (int)sizeof damaged)
            return -ENAMETOOLONG;
        if (link(path, damaged) && errno != EEXIST)
            return -errno;
        recovery->kept = true;
    }
    if (rename(copy, path))
        return -errno;
    output_sync(&(struct output){.place = path});
    return 0;
}

static int write_copy(const char *path, int old, struct mcap_reader *reader, const atomic_bool *stop,
                      struct recovery *recovery) {
    char name[PATH_MAX];
    struct stat status;

    if (snprintf(name, sizeof name, "%s.recovering", path) >= (int)sizeof name)
        return -ENAMETOOLONG;
    int fd = open(name, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0664);
    if (fd < 0)
        return -errno;
    if (!fstat(old, &status) && (status.st_uid != geteuid() || status.st_gid != getegid()))
        (void)!fchown(fd, status.st_uid, status.st_gid); /* root repairs a file of the logger's user */
    struct copy copy = {.reader = reader, .writer = mcap_writer_new(fd)};
    int error = copy_all(&copy, stop, recovery);
    mcap_writer_free(copy.writer);
    free(copy.channel);
    if (!error && fdatasync(fd))
        error = -errno;
    if (close(fd) && !error)
        error = -errno;
    if (!error)
        error = replace(path, name, copy.damaged_within, recovery);
    if (error)
        unlink(name);
    return error;
}

int recover(const char *path, const atomic_bool *stop, struct recovery *recovery, char *error) {
    *recovery = (struct recovery){.messages = 0};
    int old = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (old < 0) {
        int result = -errno;

        snprintf(error, MCAP_ERROR_MAX, "cannot be opened: %s", strerror(-result));
        return result;
    }
    if (flock(old, LOCK_EX | LOCK_NB)) { /* its writer has it locked */
        close(old);
        return -EBUSY;
    }
    int result = -EBADMSG;
    struct mcap_reader *reader = mcap_open(path, error);
    if (reader) {
        recovery->state = mcap_state(reader);
        result = recovery->state.complete ? -EALREADY : write_copy(path, old, reader, stop, recovery);
        if (result)
            snprintf(error, MCAP_ERROR_MAX, "cannot be recovered, and is unchanged: %s", strerror(-result));
    }
    mcap_close(reader);
    close(old);
    return result;
}
