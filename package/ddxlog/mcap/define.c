/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Schemas, channels and metadata of a file that is read. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "reader.h"

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
