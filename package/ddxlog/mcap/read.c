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

/* ---- Order of messages ---- */

/* Messages in the order of time: chunks overlap, since a log has its messages in the order of arrival. */

/* qsort() passes no context to by_begin(), so it sorts copies of the needed fields. */
struct begin {
    uint64_t first;
    unsigned number;
};

static int by_begin(const void *a, const void *b) {
    const struct begin *x = a, *y = b;

    if (x->first != y->first)
        return x->first < y->first ? -1 : 1;
    return x->number < y->number ? -1 : 1;
}

static int by_time(const void *a, const void *b) {
    const struct mcap_message *x = a, *y = b;

    if (x->log_time != y->log_time)
        return x->log_time < y->log_time ? -1 : 1;
    return x->data < y->data ? -1 : x->data > y->data; /* the order of the file */
}

static int make_order(struct mcap_reader *reader) {
    struct begin *begins = calloc(reader->place_count + 1, sizeof *begins);

    reader->order = calloc(reader->place_count + 1, sizeof *reader->order);
    if (!begins || !reader->order) {
        free(begins);
        return -ENOMEM;
    }
    for (unsigned i = 0; i < reader->place_count; i++)
        begins[i] = (struct begin){reader->places[i].first, i};
    qsort(begins, reader->place_count, sizeof *begins, by_begin);
    for (unsigned i = 0; i < reader->place_count; i++)
        reader->order[i] = begins[i].number;
    free(begins);
    return 0;
}

/* Load the place's messages. A damaged place has none, and is counted once. */
static int load(struct mcap_reader *reader, struct place *place, struct loaded *loaded) {
    if (place->damaged)
        return -EBADMSG;
    int error = reader_load(reader, place, loaded);
    if (error == -E2BIG)
        reader_refuse(reader, place->offset - MCAP_RECORD_HEAD);
    if (error != -EBADMSG && error != -E2BIG)
        return error;
    place->damaged = true;
    reader->state.damaged++;
    return -EBADMSG;
}

/* Make the next chunk active; it is unpacked when its first message is due. */
static int activate(struct mcap_reader *reader) {
    const struct place *place = &reader->places[reader->order[reader->next]];

    if (!(reader->active_count & (reader->active_count - 1))) { /* a power of two: full */
        size_t room = reader->active_count ? reader->active_count * 2 : 1;
        struct loaded *more = realloc(reader->active, room * sizeof *more);

        if (!more)
            return -ENOMEM;
        reader->active = more;
    }
    reader->active[reader->active_count++] = (struct loaded){.time = place->first, .number = place->number};
    reader->next++;
    return 0;
}

static bool is_before(const struct loaded *a, const struct loaded *b) {
    return a->time < b->time || (a->time == b->time && a->number < b->number);
}

/* The chunk with the earliest message, or NULL. */
static struct loaded *earliest(struct mcap_reader *reader) {
    struct loaded *found = NULL;

    for (unsigned i = 0; i < reader->active_count; i++)
        if (!found || is_before(&reader->active[i], found))
            found = &reader->active[i];
    return found;
}

static void drop(struct mcap_reader *reader, struct loaded *loaded) {
    reader->active_bytes -= loaded->bytes;
    reader_unload(loaded);
    *loaded = reader->active[--reader->active_count];
}

/* Free memory, so that `bytes` more fit: first that of the chunks needed last, which are unpacked again later. */
static void make_room(struct mcap_reader *reader, uint64_t bytes) {
    while (reader->active_bytes && reader->active_bytes + bytes > MCAP_OPEN_MAX) {
        struct loaded *last = NULL;

        for (unsigned i = 0; i < reader->active_count; i++)
            if (reader->active[i].data && (!last || is_before(last, &reader->active[i])))
                last = &reader->active[i];
        reader->active_bytes -= last->bytes;
        reader_unload(last);
    }
}

/* Unpack the chunk, and continue at its next message; a damaged chunk is dropped. */
static int unpack_one(struct mcap_reader *reader, struct loaded *chunk) {
    struct loaded fresh;

    make_room(reader, reader->places[chunk->number].unpacked);
    int error = load(reader, &reader->places[chunk->number], &fresh);
    if (error && error != -EBADMSG)
        return error;
    if (error) {
        drop(reader, chunk);
        return 0;
    }
    qsort(fresh.messages, fresh.count, sizeof *fresh.messages, by_time);
    fresh.next = chunk->next;
    *chunk = fresh;
    reader->active_bytes += fresh.bytes;
    if (fresh.next < fresh.count)
        chunk->time = fresh.messages[fresh.next].log_time;
    else
        drop(reader, chunk);
    return 0;
}

/* Advance the chunk of the message that was delivered last. */
static void step(struct mcap_reader *reader) {
    struct loaded *chunk = reader->delivered ? earliest(reader) : NULL;

    reader->delivered = false;
    if (!chunk)
        return;
    if (++chunk->next < chunk->count)
        chunk->time = chunk->messages[chunk->next].log_time;
    else
        drop(reader, chunk);
}

/* Whether the next place in order may have a message that comes before all others. */
static bool is_due(const struct mcap_reader *reader, const struct loaded *found) {
    if (reader->next >= reader->place_count)
        return false;
    const struct place *place = &reader->places[reader->order[reader->next]];
    const struct loaded next = {.time = place->first, .number = place->number};
    return !found || is_before(&next, found);
}

int mcap_next(struct mcap_reader *reader, struct mcap_message *message) {
    int error = reader->order ? 0 : make_order(reader);

    step(reader);
    while (!error) {
        struct loaded *found = earliest(reader);

        if (is_due(reader, found)) {
            error = activate(reader);
        } else if (!found) {
            return 0;
        } else if (!found->data) {
            error = unpack_one(reader, found);
        } else {
            *message = found->messages[found->next];
            reader->delivered = true;
            return 1;
        }
    }
    return error;
}

void mcap_rewind(struct mcap_reader *reader) {
    while (reader->active_count)
        drop(reader, &reader->active[0]);
    reader->delivered = false;
    reader->next = 0;
}

long mcap_chunk(struct mcap_reader *reader, unsigned index, const struct mcap_message **messages) {
    if (index >= reader->place_count)
        return -ENOENT;
    reader_unload(&reader->one);
    int error = load(reader, &reader->places[index], &reader->one);
    if (error)
        return error;
    *messages = reader->one.messages;
    return (long)reader->one.count;
}

/* ---- File ---- */

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
                             !reader_read(reader, at, magic, sizeof magic) && !memcmp(magic, MCAP_MAGIC, sizeof magic);
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
    else if (reader->size = (uint64_t)status.st_size,
             reader_read(reader, 0, magic, sizeof magic) || memcmp(magic, MCAP_MAGIC, sizeof magic))
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
