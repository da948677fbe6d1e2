/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Messages in the order of time: chunks overlap, since a log has its messages in the order of arrival. */
#include <errno.h>
#include <stdlib.h>

#include "reader.h"

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
