/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Reading a chunk from the file: unpack, check and parse it. */
#include <errno.h>
#include <lz4frame.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "reader.h"

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
