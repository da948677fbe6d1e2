/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "reader.h"

#include <errno.h>
#include <lz4frame.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* ---- Definitions ---- */

/* Schemas, channels and metadata of a file that is read. */

static void free_pairs(struct mcap_pair *pairs) {
    for (; pairs->key; pairs++) {
        free((char *)(uintptr_t)pairs->key);
        free((char *)(uintptr_t)pairs->value);
    }
}

/* A map of texts; pairs beyond MCAP_PAIRS_MAX are ignored. */
static void take_pairs(struct cursor *cursor, struct mcap_pair pairs[MCAP_PAIRS_MAX + 1]) {
    size_t size = (size_t)cursor_number(cursor, 4), count = 0;
    const unsigned char *at = cursor_bytes(cursor, size);
    struct cursor map = {at, at ? at + size : at, !at};

    while (!map.failed && cursor_left(&map)) {
        struct mcap_pair pair = {cursor_text(&map), NULL};

        pair.value = cursor_text(&map);
        if (pair.key && pair.value && count < MCAP_PAIRS_MAX) {
            pairs[count++] = pair;
            continue;
        }
        free((char *)(uintptr_t)pair.key);
        free((char *)(uintptr_t)pair.value);
    }
    cursor->failed |= map.failed;
}

static void free_schema(struct mcap_schema *schema) {
    if (!schema)
        return;
    free((char *)(uintptr_t)schema->name);
    free((char *)(uintptr_t)schema->encoding);
    free((unsigned char *)(uintptr_t)schema->data);
    free(schema);
}

static void free_channel(struct own_channel *channel) {
    if (!channel)
        return;
    free((char *)(uintptr_t)channel->channel.topic);
    free((char *)(uintptr_t)channel->channel.encoding);
    free_pairs(channel->pairs);
    free(channel);
}

static void free_metadata(struct own_metadata *metadata) {
    free(metadata->name);
    free_pairs(metadata->pairs);
}

/* A repeated definition (in the summary, in a later chunk) is ignored: the first one counts. */
static int define_schema(struct mcap_reader *reader, struct cursor cursor) {
    uint16_t id = (uint16_t)cursor_number(&cursor, 2);
    struct mcap_schema *schema = calloc(1, sizeof *schema);

    if (!schema)
        return -ENOMEM;
    schema->id = id;
    schema->name = cursor_text(&cursor);
    schema->encoding = cursor_text(&cursor);
    schema->size = (size_t)cursor_number(&cursor, 4);
    const unsigned char *data = cursor_bytes(&cursor, schema->size);
    unsigned char *copy = data ? malloc(schema->size + 1) : NULL;
    if (copy) {
        memcpy(copy, data, schema->size);
        copy[schema->size] = 0;
    }
    schema->data = copy;
    bool good = copy && !cursor.failed && id;
    if (!good || reader->schemas[id]) {
        free_schema(schema);
        return good ? 0 : -EBADMSG;
    }
    reader->schemas[id] = schema;
    reader->ids = id >= reader->ids ? id + 1u : reader->ids;
    return 0;
}

static int define_channel(struct mcap_reader *reader, struct cursor cursor) {
    struct own_channel *own = calloc(1, sizeof *own);

    if (!own)
        return -ENOMEM;
    own->channel.id = (uint16_t)cursor_number(&cursor, 2);
    own->channel.schema = (uint16_t)cursor_number(&cursor, 2);
    own->channel.topic = cursor_text(&cursor);
    own->channel.encoding = cursor_text(&cursor);
    own->channel.metadata = own->pairs;
    take_pairs(&cursor, own->pairs);
    if (cursor.failed || reader->channels[own->channel.id]) {
        free_channel(own);
        return cursor.failed ? -EBADMSG : 0;
    }
    reader->channels[own->channel.id] = own;
    reader->ids = own->channel.id >= reader->ids ? own->channel.id + 1u : reader->ids;
    return 0;
}

static int define_metadata(struct mcap_reader *reader, struct cursor cursor) {
    struct own_metadata *more = realloc(reader->metadata, (reader->metadata_count + 1) * sizeof *more);

    if (!more)
        return -ENOMEM;
    reader->metadata = more;
    more += reader->metadata_count;
    memset(more, 0, sizeof *more);
    more->name = cursor_text(&cursor);
    take_pairs(&cursor, more->pairs);
    if (cursor.failed) {
        free_metadata(more);
        return -EBADMSG;
    }
    reader->metadata_count++;
    return 0;
}

static bool is_defined(const struct mcap_reader *reader, enum mcap_opcode opcode, struct cursor cursor) {
    uint16_t id = (uint16_t)cursor_number(&cursor, 2);

    return opcode == MCAP_SCHEMA ? reader->schemas[id] != NULL : opcode == MCAP_CHANNEL && reader->channels[id];
}

int reader_define(struct mcap_reader *reader, enum mcap_opcode opcode, const unsigned char *content, size_t size) {
    struct cursor cursor = {content, content + size, false};
    size_t bytes = is_defined(reader, opcode, cursor) ? 0 : size + sizeof(struct own_channel);
    int error = -EBADMSG;

    if (bytes > MCAP_DEFINED_MAX - reader->defined)
        return -E2BIG;
    switch (opcode) {
    case MCAP_SCHEMA: error = define_schema(reader, cursor); break;
    case MCAP_CHANNEL: error = define_channel(reader, cursor); break;
    case MCAP_METADATA: error = define_metadata(reader, cursor); break;
    default: break;
    }
    reader->defined += error ? 0 : bytes;
    return error;
}

const struct mcap_schema *mcap_schema(const struct mcap_reader *reader, uint16_t id) {
    return reader->schemas[id];
}

const struct mcap_channel *mcap_channel(const struct mcap_reader *reader, uint16_t id) {
    return reader->channels[id] ? &reader->channels[id]->channel : NULL;
}

static const char *value_of(const struct mcap_pair *pairs, const char *key) {
    for (; pairs->key; pairs++)
        if (!strcmp(pairs->key, key))
            return pairs->value;
    return NULL;
}

const char *mcap_value(const struct mcap_channel *channel, const char *key) {
    return value_of(channel->metadata, key);
}

const char *mcap_metadata(const struct mcap_reader *reader, const char *name, const char *key) {
    for (unsigned i = 0; i < reader->metadata_count; i++)
        if (!strcmp(reader->metadata[i].name, name))
            return value_of(reader->metadata[i].pairs, key);
    return NULL;
}

const char *mcap_metadata_at(const struct mcap_reader *reader, unsigned index, const struct mcap_pair **pairs) {
    if (index >= reader->metadata_count)
        return NULL;
    *pairs = reader->metadata[index].pairs;
    return reader->metadata[index].name;
}

void reader_forget(struct mcap_reader *reader) {
    for (unsigned id = 0; id < reader->ids; id++) {
        free_schema(reader->schemas[id]);
        free_channel(reader->channels[id]);
    }
    for (unsigned i = 0; i < reader->metadata_count; i++)
        free_metadata(&reader->metadata[i]);
    free(reader->metadata);
}

/* ---- Chunks ---- */

/* Reading a chunk from the file: unpack, check and parse it. */

int reader_read(const struct mcap_reader *reader, uint64_t offset, void *data, size_t size) {
    unsigned char *to = data;

    while (size) {
        ssize_t done = pread(reader->fd, to, size, (off_t)offset);

        if (done < 0 && errno != EINTR)
            return -errno;
        if (!done)
            return -EBADMSG;
        if (done > 0) {
            to += done;
            offset += (uint64_t)done;
            size -= (size_t)done;
        }
    }
    return 0;
}

void reader_refuse(struct mcap_reader *reader, uint64_t offset) {
    if (!reader->state.refused++)
        reader->state.refused_at = offset;
}

static int unpack_lz4(const unsigned char *packed, size_t packed_size, unsigned char *data, size_t size) {
    LZ4F_dctx *context;
    if (LZ4F_isError(LZ4F_createDecompressionContext(&context, LZ4F_VERSION)))
        return -ENOMEM;
    size_t from = 0, to = 0, more = 1;
    while (more && from < packed_size) {
        size_t taken = packed_size - from, given = size - to;

        more = LZ4F_decompress(context, data + to, &given, packed + from, &taken, NULL);
        if (LZ4F_isError(more) || (!taken && !given))
            break;
        from += taken;
        to += given;
    }
    LZ4F_freeDecompressionContext(context);
    return more || to != size ? -EBADMSG : 0;
}

/* Unpack the content of a chunk record: the records in it. */
static int unpack(const unsigned char *content, size_t length, unsigned char **data, size_t *size) {
    struct cursor cursor = {content + 16, content + length, false};
    uint64_t unpacked = cursor_number(&cursor, 8);
    uint32_t crc = (uint32_t)cursor_number(&cursor, 4);
    size_t name_size = (size_t)cursor_number(&cursor, 4);
    const unsigned char *name = cursor_bytes(&cursor, name_size);
    uint64_t packed_size = cursor_number(&cursor, 8);
    const unsigned char *packed = cursor_bytes(&cursor, packed_size);
    bool lz4 = name && name_size == 3 && !memcmp(name, "lz4", 3);

    /* LZ4 packs to a 255th at best: a larger declared size is invalid, so do not allocate that much memory. */
    if (!packed || (name_size && !lz4) || unpacked > MCAP_CHUNK_MAX || unpacked > packed_size * 256 + 1024)
        return -EBADMSG;
    *data = malloc((size_t)unpacked + 1);
    if (!*data)
        return -ENOMEM;
    *size = (size_t)unpacked;
    int error = 0;
    if (lz4)
        error = unpack_lz4(packed, (size_t)packed_size, *data, *size);
    else if (packed_size == unpacked)
        memcpy(*data, packed, *size);
    else
        error = -EBADMSG;
    if (!error && crc && crc32_of(0, *data, *size) != crc)
        error = -EBADMSG;
    return error;
}

static int add_message(struct loaded *loaded, const unsigned char *content, size_t size) {
    struct cursor cursor = {content, content + size, false};

    struct mcap_message *message = &loaded->messages[loaded->count];
    message->channel = (uint16_t)cursor_number(&cursor, 2);
    message->sequence = (uint32_t)cursor_number(&cursor, 4);
    message->log_time = cursor_number(&cursor, 8);
    message->publish_time = cursor_number(&cursor, 8);
    message->size = cursor_left(&cursor);
    message->data = cursor.at;
    if (cursor.failed)
        return -EBADMSG;
    loaded->count++;
    return 0;
}

/* For an array of exactly this size: doubling it would cost more than the chunk itself. */
static size_t count_messages(struct cursor cursor) {
    size_t count = 0;

    while (cursor_left(&cursor) && !cursor.failed) {
        count += cursor_number(&cursor, 1) == MCAP_MESSAGE;
        cursor_bytes(&cursor, cursor_number(&cursor, 8));
    }
    return count;
}

static int take_apart(struct mcap_reader *reader, struct loaded *loaded, size_t size) {
    struct cursor cursor = {loaded->data, loaded->data + size, false};
    size_t count = count_messages(cursor);

    loaded->messages = calloc(count + 1, sizeof *loaded->messages);
    if (!loaded->messages)
        return -ENOMEM;
    loaded->bytes = size + count * sizeof *loaded->messages;
    while (cursor_left(&cursor)) {
        enum mcap_opcode opcode = (enum mcap_opcode)cursor_number(&cursor, 1);
        uint64_t length = cursor_number(&cursor, 8);
        const unsigned char *content = cursor_bytes(&cursor, length);
        int error = 0;

        if (!content)
            return -EBADMSG;
        if (opcode == MCAP_MESSAGE)
            error = add_message(loaded, content, (size_t)length);
        else if (opcode == MCAP_SCHEMA || opcode == MCAP_CHANNEL)
            error = reader_define(reader, opcode, content, (size_t)length);
        if (error)
            return error;
    }
    return 0;
}

int reader_load(struct mcap_reader *reader, const struct place *place, struct loaded *loaded) {
    memset(loaded, 0, sizeof *loaded);
    loaded->number = place->number;
    if (place->length > MCAP_PACKED_MAX)
        return -EBADMSG;
    unsigned char *content = malloc((size_t)place->length + 1);
    if (!content)
        return -ENOMEM;
    int error = reader_read(reader, place->offset, content, (size_t)place->length);
    size_t size = 0;
    if (!error)
        error = unpack(content, (size_t)place->length, &loaded->data, &size);
    free(content);
    if (!error)
        error = take_apart(reader, loaded, size);
    if (error)
        reader_unload(loaded);
    return error;
}

void reader_unload(struct loaded *loaded) {
    free(loaded->data);
    free(loaded->messages);
    loaded->data = NULL;
    loaded->messages = NULL;
    loaded->bytes = 0;
}
