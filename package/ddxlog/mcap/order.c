/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Messages in the order of time: chunks overlap, since a log holds them as they came in. */
#include <errno.h>
#include <stdlib.h>

#include "reader.h"

/* Sorting is not told whose places these are, so it sorts copies of what it needs. */
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

/* The place's messages; a damaged one has none, and is counted once. */
static int load(struct mcap_reader *reader, struct place *place, struct loaded *loaded) {
    int error = place->damaged ? -EBADMSG : reader_load(reader, place, loaded);

    if (error == -EBADMSG && !place->damaged) {
        place->damaged = true;
        reader->state.damaged++;
    }
    return error;
}

static int activate(struct mcap_reader *reader) {
    struct loaded loaded, *more;
    int error = load(reader, &reader->places[reader->order[reader->next]], &loaded);

    if (error && error != -EBADMSG)
        return error;
    reader->next++;
    if (error)
        return 0;
    if (!loaded.count) {
        reader_unload(&loaded);
        return 0;
    }
    qsort(loaded.messages, loaded.count, sizeof *loaded.messages, by_time);
    more = realloc(reader->active, (reader->active_count + 1) * sizeof *more);
    if (!more) {
        reader_unload(&loaded);
        return -ENOMEM;
    }
    reader->active = more;
    more[reader->active_count++] = loaded;
    return 0;
}

/* The chunk with the earliest message, or NULL. */
static struct loaded *earliest(struct mcap_reader *reader) {
    struct loaded *found = NULL;

    for (unsigned i = 0; i < reader->active_count; i++) {
        struct loaded *one = &reader->active[i];
        uint64_t time = one->messages[one->next].log_time;
        uint64_t best = found ? found->messages[found->next].log_time : 0;

        if (!found || time < best || (time == best && one->number < found->number))
            found = one;
    }
    return found;
}

/* What was delivered to its end goes now, that nobody looks at it any more. */
static void drop_finished(struct mcap_reader *reader) {
    for (unsigned i = 0; i < reader->active_count;) {
        if (reader->active[i].next < reader->active[i].count) {
            i++;
            continue;
        }
        reader_unload(&reader->active[i]);
        reader->active[i] = reader->active[--reader->active_count];
    }
}

int mcap_next(struct mcap_reader *reader, struct mcap_message *message) {
    int error = reader->order ? 0 : make_order(reader);

    drop_finished(reader);
    struct loaded *found = earliest(reader);
    while (!error && reader->next < reader->place_count &&
           (!found || reader->places[reader->order[reader->next]].first <= found->messages[found->next].log_time)) {
        error = activate(reader);
        found = earliest(reader);
    }
    if (error)
        return error;
    if (!found)
        return 0;
    *message = found->messages[found->next++];
    return 1;
}

void mcap_rewind(struct mcap_reader *reader) {
    for (unsigned i = 0; i < reader->active_count; i++)
        reader_unload(&reader->active[i]);
    reader->active_count = 0;
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
