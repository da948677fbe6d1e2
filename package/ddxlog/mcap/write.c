/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Writing MCAP: chunks are filled, packed and written; records for the summary are kept in memory until the end. */
#include <errno.h>
#include <lz4frame.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "record.h"

#define LIBRARY "ddxlog 0.1"

/* Places of a channel's messages in the chunk, and their number in the file. */
struct index {
    struct bytes entries; /* the Message Index's: log time, offset */
    uint64_t messages;
};

struct mcap_writer {
    int fd, error;
    uint64_t written;   /* bytes written completely */
    uint32_t crc;       /* of these bytes */
    struct bytes fresh; /* records to be written before the chunk */
    struct bytes chunk, packed;
    uint64_t chunk_first, chunk_last;
    uint32_t chunk_messages;
    struct index *index; /* by channel id */
    /* for the summary */
    struct bytes schemas, channels, chunk_indexes, metadata_indexes;
    uint32_t schema_count, channel_count, chunk_count, metadata_count;
    uint64_t messages, first, last;
};

/* Begin a record. Returns the offset of its content, for end_record(), which writes the length. */
static size_t begin_record(struct bytes *bytes, enum mcap_opcode opcode) {
    bytes_number(bytes, opcode, 1);
    bytes_number(bytes, 0, 8);
    return bytes->size;
}

static void end_record(struct bytes *bytes, size_t begin) {
    if (!bytes->failed)
        bytes_number_at(bytes, begin - 8, bytes->size - begin, 8);
}

static void put_pairs(struct bytes *bytes, const struct mcap_pair *pairs) {
    size_t at = bytes->size;

    bytes_number(bytes, 0, 4);
    for (; pairs && pairs->key; pairs++) {
        bytes_text(bytes, pairs->key);
        bytes_text(bytes, pairs->value);
    }
    if (!bytes->failed)
        bytes_number_at(bytes, at, bytes->size - at - 4, 4);
}

struct mcap_writer *mcap_writer_new(int fd) {
    struct mcap_writer *writer = calloc(1, sizeof *writer);

    if (!writer)
        return NULL;
    writer->fd = fd;
    bytes_put(&writer->fresh, MCAP_MAGIC, MCAP_MAGIC_SIZE);
    size_t record = begin_record(&writer->fresh, MCAP_HEADER);
    bytes_text(&writer->fresh, "");
    bytes_text(&writer->fresh, LIBRARY);
    end_record(&writer->fresh, record);
    return writer;
}

void mcap_writer_free(struct mcap_writer *writer) {
    if (!writer)
        return;
    struct bytes *all[] = {&writer->fresh,    &writer->chunk,         &writer->packed,          &writer->schemas,
                           &writer->channels, &writer->chunk_indexes, &writer->metadata_indexes};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        bytes_free(all[i]);
    for (uint32_t id = 1; id <= writer->channel_count; id++)
        bytes_free(&writer->index[id].entries);
    free(writer->index);
    free(writer);
}

void mcap_put_metadata(struct mcap_writer *writer, const char *name, const struct mcap_pair *pairs) {
    size_t begin = writer->fresh.size;
    size_t record = begin_record(&writer->fresh, MCAP_METADATA);

    bytes_text(&writer->fresh, name);
    put_pairs(&writer->fresh, pairs);
    end_record(&writer->fresh, record);
    record = begin_record(&writer->metadata_indexes, MCAP_METADATA_INDEX);
    bytes_number(&writer->metadata_indexes, writer->written + begin, 8);
    bytes_number(&writer->metadata_indexes, writer->fresh.size - begin, 8);
    bytes_text(&writer->metadata_indexes, name);
    end_record(&writer->metadata_indexes, record);
    writer->metadata_count++;
}

/* Append a record of the data to the summary as well. */
static void put_twice(struct mcap_writer *writer, struct bytes *summary, size_t begin) {
    if (writer->fresh.failed)
        summary->failed = true;
    else
        bytes_put(summary, writer->fresh.data + begin, writer->fresh.size - begin);
}

void mcap_put_schema(struct mcap_writer *writer, const struct mcap_schema *schema) {
    struct bytes *to = &writer->fresh;
    size_t begin = to->size, record = begin_record(to, MCAP_SCHEMA);

    bytes_number(to, schema->id, 2);
    bytes_text(to, schema->name);
    bytes_text(to, schema->encoding);
    bytes_number(to, schema->size, 4);
    bytes_put(to, schema->data, schema->size);
    end_record(to, record);
    put_twice(writer, &writer->schemas, begin);
    writer->schema_count++;
}

void mcap_put_channel(struct mcap_writer *writer, const struct mcap_channel *channel) {
    struct index *index = realloc(writer->index, (writer->channel_count + 2) * sizeof *index);

    if (!index) {
        writer->error = -ENOMEM;
        return;
    }
    writer->index = index;
    index[++writer->channel_count] = (struct index){.messages = 0};
    struct bytes *to = &writer->fresh;
    size_t begin = to->size, record = begin_record(to, MCAP_CHANNEL);
    bytes_number(to, channel->id, 2);
    bytes_number(to, channel->schema, 2);
    bytes_text(to, channel->topic);
    bytes_text(to, channel->encoding);
    put_pairs(to, channel->metadata);
    end_record(to, record);
    put_twice(writer, &writer->channels, begin);
}

unsigned char *mcap_put_message_space(struct mcap_writer *writer, const struct mcap_message *message) {
    if (writer->error || !message->channel || message->channel > writer->channel_count)
        return NULL;
    struct bytes *to = &writer->chunk, *entries = &writer->index[message->channel].entries;
    size_t before = to->size, before_entries = entries->size;
    size_t record = begin_record(to, MCAP_MESSAGE);
    bytes_number(to, message->channel, 2);
    bytes_number(to, message->sequence, 4);
    bytes_number(to, message->log_time, 8);
    bytes_number(to, message->publish_time, 8);
    unsigned char *data = to->failed ? NULL : bytes_extend(to, message->size);
    end_record(to, record);
    bytes_number(entries, message->log_time, 8);
    bytes_number(entries, before, 8);
    if (to->failed || entries->failed) { /* drop this message; the chunk stays valid */
        to->size = before;
        entries->size = before_entries;
        to->failed = entries->failed = false;
        return NULL;
    }
    if (!writer->chunk_messages || message->log_time < writer->chunk_first)
        writer->chunk_first = message->log_time;
    if (!writer->chunk_messages || message->log_time > writer->chunk_last)
        writer->chunk_last = message->log_time;
    writer->chunk_messages++;
    return data;
}

void mcap_put_message(struct mcap_writer *writer, const struct mcap_message *message) {
    unsigned char *data = mcap_put_message_space(writer, message);

    if (!data)
        writer->error = writer->error ? writer->error : -ENOMEM;
    else if (message->size)
        memcpy(data, message->data, message->size);
}

size_t mcap_pending(const struct mcap_writer *writer) {
    return writer->chunk.size;
}

uint64_t mcap_written(const struct mcap_writer *writer) {
    return writer->written;
}

static int write_all(int fd, const unsigned char *data, size_t size) {
    while (size) {
        ssize_t done = write(fd, data, size);

        if (done < 0 && errno != EINTR)
            return -errno;
        if (done > 0) {
            data += done;
            size -= (size_t)done;
        }
    }
    return 0;
}

/* Append the chunk as a record, and its indexes. */
static void pack(struct mcap_writer *writer) {
    struct bytes *to = &writer->fresh, *summary = &writer->chunk_indexes;
    LZ4F_preferences_t preferences = {.frameInfo = {.contentSize = writer->chunk.size}};
    size_t bound = LZ4F_compressFrameBound(writer->chunk.size, &preferences);

    bytes_clear(&writer->packed);
    void *room = bytes_extend(&writer->packed, bound);
    if (!room) {
        to->failed = true;
        return;
    }
    size_t packed = LZ4F_compressFrame(room, bound, writer->chunk.data, writer->chunk.size, &preferences);
    if (LZ4F_isError(packed)) {
        to->failed = true;
        return;
    }
    uint64_t at = writer->written + to->size;
    size_t begin = to->size, record = begin_record(to, MCAP_CHUNK);
    bytes_number(to, writer->chunk_first, 8);
    bytes_number(to, writer->chunk_last, 8);
    bytes_number(to, writer->chunk.size, 8);
    bytes_number(to, crc32_of(0, writer->chunk.data, writer->chunk.size), 4);
    bytes_text(to, "lz4");
    bytes_number(to, packed, 8);
    bytes_put(to, writer->packed.data, packed);
    end_record(to, record);
    size_t length = to->size - begin;

    size_t summary_record = begin_record(summary, MCAP_CHUNK_INDEX);
    bytes_number(summary, writer->chunk_first, 8);
    bytes_number(summary, writer->chunk_last, 8);
    bytes_number(summary, at, 8);
    bytes_number(summary, length, 8);
    size_t map = summary->size, indexes = to->size;
    bytes_number(summary, 0, 4);
    for (uint32_t id = 1; id <= writer->channel_count; id++) {
        struct index *index = &writer->index[id];

        if (!index->entries.size)
            continue;
        bytes_number(summary, id, 2);
        bytes_number(summary, writer->written + to->size, 8);
        record = begin_record(to, MCAP_MESSAGE_INDEX);
        bytes_number(to, id, 2);
        bytes_number(to, index->entries.size, 4);
        bytes_put(to, index->entries.data, index->entries.size);
        end_record(to, record);
        index->messages += index->entries.size / 16;
        bytes_clear(&index->entries);
    }
    if (!summary->failed)
        bytes_number_at(summary, map, summary->size - map - 4, 4);
    bytes_number(summary, to->size - indexes, 8);
    bytes_text(summary, "lz4");
    bytes_number(summary, packed, 8);
    bytes_number(summary, writer->chunk.size, 8);
    end_record(summary, summary_record);

    if (!writer->messages || writer->chunk_first < writer->first)
        writer->first = writer->chunk_first;
    if (!writer->messages || writer->chunk_last > writer->last)
        writer->last = writer->chunk_last;
    writer->messages += writer->chunk_messages;
    writer->chunk_count++;
    writer->chunk_messages = 0;
    bytes_clear(&writer->chunk);
}

int mcap_flush(struct mcap_writer *writer) {
    if (!writer->error && writer->chunk_messages)
        pack(writer);
    if (!writer->error && (writer->fresh.failed || writer->chunk_indexes.failed || writer->metadata_indexes.failed ||
                           writer->schemas.failed || writer->channels.failed))
        writer->error = -ENOMEM;
    if (!writer->error)
        writer->error = write_all(writer->fd, writer->fresh.data, writer->fresh.size);
    if (writer->error)
        return writer->error;
    writer->crc = crc32_of(writer->crc, writer->fresh.data, writer->fresh.size);
    writer->written += writer->fresh.size;
    bytes_clear(&writer->fresh);
    return 0;
}

static void put_statistics(const struct mcap_writer *writer, struct bytes *to) {
    size_t record = begin_record(to, MCAP_STATISTICS);

    bytes_number(to, writer->messages, 8);
    bytes_number(to, writer->schema_count, 2);
    bytes_number(to, writer->channel_count, 4);
    bytes_number(to, 0, 4); /* attachments */
    bytes_number(to, writer->metadata_count, 4);
    bytes_number(to, writer->chunk_count, 4);
    bytes_number(to, writer->first, 8);
    bytes_number(to, writer->last, 8);
    bytes_number(to, writer->channel_count * UINT32_C(10), 4);
    for (uint32_t id = 1; id <= writer->channel_count; id++) {
        bytes_number(to, id, 2);
        bytes_number(to, writer->index[id].messages, 8);
    }
    end_record(to, record);
}

int mcap_finish(struct mcap_writer *writer) {
    int error = mcap_flush(writer);

    if (error)
        return error;
    struct bytes *to = &writer->fresh, statistics = {.data = NULL}, offsets = {.data = NULL};
    size_t record = begin_record(to, MCAP_DATA_END);
    bytes_number(to, writer->crc, 4);
    end_record(to, record);

    put_statistics(writer, &statistics);
    size_t summary = to->size;
    const struct bytes *groups[] = {&writer->schemas, &writer->channels, &statistics, &writer->metadata_indexes,
                                    &writer->chunk_indexes};
    for (size_t i = 0; i < sizeof groups / sizeof *groups; i++) {
        if (!groups[i]->size)
            continue;
        record = begin_record(&offsets, MCAP_SUMMARY_OFFSET);
        bytes_number(&offsets, groups[i]->data[0], 1); /* the opcode of the group */
        bytes_number(&offsets, writer->written + to->size, 8);
        bytes_number(&offsets, groups[i]->size, 8);
        end_record(&offsets, record);
        bytes_put(to, groups[i]->data, groups[i]->size);
    }
    uint64_t offsets_at = writer->written + to->size;
    bytes_put(to, offsets.data, offsets.size);
    begin_record(to, MCAP_FOOTER);
    if (!to->failed)
        bytes_number_at(to, to->size - 8, 20, 8);
    bytes_number(to, writer->written + summary, 8);
    bytes_number(to, offsets_at, 8);
    if (!to->failed)
        bytes_number(to, crc32_of(0, to->data + summary, to->size - summary), 4);
    bytes_put(to, MCAP_MAGIC, MCAP_MAGIC_SIZE);
    to->failed |= statistics.failed || offsets.failed;
    bytes_free(&statistics);
    bytes_free(&offsets);
    return mcap_flush(writer);
}
