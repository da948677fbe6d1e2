/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Reading MCAP: from the first record to the last whole one, without the summary, which a truncated file lacks. */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "reader.h"

__attribute__((format(printf, 2, 3))) static void *fail(char *error, const char *format, ...) {
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(error, MCAP_ERROR_MAX, format, arguments);
    va_end(arguments);
    return NULL;
}

static int add_place(struct mcap_reader *reader, struct place place) {
    if (!(reader->place_count & (reader->place_count - 1))) { /* a power of two: full */
        size_t room = reader->place_count ? reader->place_count * 2 : 1;
        struct place *more = realloc(reader->places, room * sizeof *more);
        if (!more)
            return -ENOMEM;
        reader->places = more;
    }
    place.number = reader->place_count;
    reader->places[reader->place_count++] = place;
    return 0;
}

bool mcap_refused_text(const struct mcap_state *state, char *text) {
    char others[40] = "";

    if (state->refused > 1)
        snprintf(others, sizeof others, ", and %u others", state->refused - 1);
    snprintf(text, MCAP_ERROR_MAX,
             "the record at byte %" PRIu64 "%s exceeds the limit for memory (a chunk: %u MiB) and is left out",
             state->refused_at, others, (unsigned)(MCAP_CHUNK_MAX >> 20));
    return state->refused;
}

static int take_chunk(struct mcap_reader *reader, uint64_t at, uint64_t length) {
    unsigned char head[24];

    if (length < MCAP_CHUNK_HEAD)
        return -EBADMSG;
    int error = reader_read(reader, at, head, sizeof head);
    if (error)
        return error;
    struct cursor cursor = {head, head + sizeof head, false};
    struct place place = {.offset = at, .length = length, .first = cursor_number(&cursor, 8)};
    place.last = cursor_number(&cursor, 8);
    place.unpacked = cursor_number(&cursor, 8);
    place.damaged = length > MCAP_PACKED_MAX || place.unpacked > MCAP_CHUNK_MAX;
    if (place.damaged) {
        reader_refuse(reader, at - MCAP_RECORD_HEAD);
        reader->state.damaged++;
    }
    return add_place(reader, place);
}

static int take_definition(struct mcap_reader *reader, enum mcap_opcode opcode, uint64_t at, uint64_t length) {
    if (length > MCAP_RECORD_MAX) {
        reader_refuse(reader, at - MCAP_RECORD_HEAD);
        return 0;
    }
    unsigned char *content = malloc((size_t)length + 1);
    if (!content)
        return -ENOMEM;
    int error = reader_read(reader, at, content, (size_t)length);
    if (!error)
        error = reader_define(reader, opcode, content, (size_t)length);
    free(content);
    if (error != -E2BIG)
        return error;
    reader_refuse(reader, at - MCAP_RECORD_HEAD);
    return 0;
}

/* Read the record at `at`; *next: offset of the record after it. -EBADMSG: not a whole record. */
static int take_record(struct mcap_reader *reader, uint64_t at, uint64_t *next, enum mcap_opcode *opcode) {
    unsigned char head[MCAP_RECORD_HEAD];

    if (reader->size - at < sizeof head)
        return -EBADMSG;
    int error = reader_read(reader, at, head, sizeof head);
    if (error)
        return error;
    struct cursor cursor = {head, head + sizeof head, false};
    *opcode = (enum mcap_opcode)cursor_number(&cursor, 1);
    uint64_t length = cursor_number(&cursor, 8);
    at += sizeof head;
    if (!*opcode || (*opcode >= MCAP_OPCODE_END && *opcode < 0x80) || length > reader->size - at)
        return -EBADMSG;
    *next = at + length;
    switch (*opcode) {
    case MCAP_CHUNK: return take_chunk(reader, at, length);
    case MCAP_SCHEMA:
    case MCAP_CHANNEL:
    case MCAP_METADATA: return take_definition(reader, *opcode, at, length);
    default: return 0;
    }
}

static int look_through(struct mcap_reader *reader) {
    uint64_t at = MCAP_MAGIC_SIZE, next = at;
    enum mcap_opcode opcode = MCAP_HEADER;
    bool data_end = false;

    while (at < reader->size) {
        int error = take_record(reader, at, &next, &opcode);

        if (error == -EBADMSG)
            break;
        if (error)
            return error;
        at = next;
        data_end |= opcode == MCAP_DATA_END;
        if (opcode == MCAP_FOOTER)
            break;
    }
    unsigned char magic[MCAP_MAGIC_SIZE];
    reader->state.complete = data_end && opcode == MCAP_FOOTER && reader->size - at == sizeof magic &&
                             !reader_read(reader, at, magic, sizeof magic) &&
                             !memcmp(magic, MCAP_MAGIC, sizeof magic);
    reader->state.left_over = reader->state.complete ? 0 : reader->size - at;
    reader->state.chunks = reader->place_count;
    return 0;
}

struct mcap_reader *mcap_open(const char *path, char *error) {
    struct mcap_reader *reader = calloc(1, sizeof *reader);
    struct stat status;
    unsigned char magic[MCAP_MAGIC_SIZE];

    if (!reader)
        return fail(error, "no memory");
    reader->fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    int result = 0;
    if (reader->fd < 0 || fstat(reader->fd, &status))
        fail(error, "cannot be opened: %s", strerror(errno));
    else if (!S_ISREG(status.st_mode))
        fail(error, "is no file");
    else if (reader->size = (uint64_t)status.st_size, reader_read(reader, 0, magic, sizeof magic) ||
                                                          memcmp(magic, MCAP_MAGIC, sizeof magic))
        fail(error, "%s", reader->size ? "is no MCAP file" : "is empty");
    else if ((result = look_through(reader)))
        fail(error, "cannot be read: %s", strerror(-result));
    else
        return reader;
    mcap_close(reader);
    return NULL;
}

void mcap_close(struct mcap_reader *reader) {
    if (!reader)
        return;
    mcap_rewind(reader);
    reader_unload(&reader->one);
    reader_forget(reader);
    free(reader->active);
    free(reader->order);
    free(reader->places);
    if (reader->fd >= 0)
        close(reader->fd);
    free(reader);
}

struct mcap_state mcap_state(const struct mcap_reader *reader) {
    return reader->state;
}

void mcap_times(const struct mcap_reader *reader, uint64_t *first, uint64_t *last) {
    *first = *last = 0;
    for (unsigned i = 0; i < reader->place_count; i++) {
        const struct place *place = &reader->places[i];

        if (!i || place->first < *first)
            *first = place->first;
        if (!i || place->last > *last)
            *last = place->last;
    }
}
