/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "mirror.h"

#include <envelope.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "item.h"

#define UNREAD_NS INT64_C(5000000000) /* without a reader, until a mirror is closed */

struct mirror {
    struct mirror *next;
    struct catalog *catalog;
    char name[DDX_NAME_MAX + 1];
    uint64_t machine; /* the origin of the item */
    uint64_t version; /* of the announcement; 0: the mirror is closed */
    DDX_STORE_ITEM *item;
    struct form *form; /* of the item, in this store */
    struct network_event event;
    struct network_reader *reader;
    uint64_t writer, sequence; /* of the last message; 0: none since the reader was opened */
    int64_t time;              /* of the last message, in the origin's clock */
    int64_t read;              /* last time that there was a reader */
};

struct mirrors {
    struct catalog *catalog;
    struct mirror *first;
};

/* Write a received value into the store. 0 or -errno. */
static int write_value(struct mirror *mirror, const unsigned char *fields, int64_t time) {
    int64_t local = clock_local(mirror->catalog, mirror->machine, time);
    void *data;
    int error = item_loan(mirror->item, mirror->form, &data);

    if (error)
        return error;
    form_unpack(mirror->form, fields - FORM_HEADER, data);
    return ddx_store_publish(mirror->item, local ? &local : NULL); /* else the time of arrival */
}

static void count(struct mirror *mirror, uint64_t missed, int error, int64_t since) {
    DDX_STATS_BOOK *book = mirror->catalog->book;

    ddx_stats_in(book, 1 + missed, 0);
    if (missed)
        ddx_stats_lost(book, LOST_NETWORK, missed);
    if (error)
        ddx_stats_lost(book, LOST_BUDGET, 1);
    else
        ddx_stats_out(book, 1, ddx_time_now() - since);
}

/* After joining the network again, an origin has another writer, which numbers its messages from 1. */
static uint64_t missed_before(const struct mirror *mirror, uint64_t writer, uint64_t sequence) {
    bool follows = mirror->sequence && mirror->writer == writer && sequence > mirror->sequence;

    return follows ? sequence - mirror->sequence - 1 : 0;
}

/* The origin repeats its newest value for each new reader, and after joining the network again. */
static bool is_repeated(const struct mirror *mirror, uint64_t writer, const struct envelope *envelope) {
    return mirror->sequence && envelope->monotonic == mirror->time &&
           (envelope->sequence == mirror->sequence || writer != mirror->writer);
}

static void take_message(void *argument, uint64_t writer, const unsigned char *message, size_t size) {
    struct mirror *mirror = argument;
    struct envelope envelope;
    int64_t begin = ddx_time_now();
    const unsigned char *fields = envelope_read(mirror->form, message, size, &envelope);

    if (!fields) {
        ddx_stats_in(mirror->catalog->book, 1, 0);
        ddx_stats_lost(mirror->catalog->book, LOST_TYPE, 1);
        return;
    }
    bool repeated = is_repeated(mirror, writer, &envelope);
    uint64_t missed = missed_before(mirror, writer, envelope.sequence);
    mirror->writer = writer;
    mirror->sequence = envelope.sequence;
    mirror->time = envelope.monotonic;
    if (!repeated)
        count(mirror, missed, write_value(mirror, fields, envelope.monotonic), begin);
}

static void ready(void *argument) {
    struct mirror *mirror = argument;

    network_read(mirror->reader, take_message, mirror);
}

static int subscribe(struct mirror *mirror, const struct remote *remote) {
    struct description *description;
    int error = envelope_describe(mirror->form, &description);

    if (error)
        return error;
    mirror->event = (struct network_event){ready, mirror};
    mirror->sequence = 0;
    error = network_reader_open(mirror->catalog->network, remote->topic, description,
                                remote->message_size + NAME_MACHINE, &mirror->event, &mirror->reader);
    description_free(description);
    return error ? -EPROTO : 0;
}

static void unsubscribe(struct mirror *mirror) {
    network_reader_close(mirror->reader);
    mirror->reader = NULL;
}

static void close_mirror(struct mirror *mirror) {
    unsubscribe(mirror);
    ddx_store_done_item(mirror->item);
    form_free(mirror->form);
    mirror->item = NULL;
    mirror->form = NULL;
    mirror->version = 0;
}

static int create(struct mirror *mirror, const struct remote *remote) {
    struct ddx_extent extents[64];
    char *text = strdup(remote->extents);
    struct ddx_item_spec spec = {
        .name = mirror->name, .type = remote->type, .declaration = remote->declaration, .extents = extents};

    if (!text)
        return -ENOMEM;
    spec.extent_count = form_list_extents(text, extents, sizeof extents / sizeof *extents);
    int error = ddx_store_create(mirror->catalog->id, &spec, &mirror->item);
    free(text);
    return error;
}

/* Open item and reader according to the origin's announcement. 0, or -errno, and then the mirror is closed. */
static int open_mirror(struct mirror *mirror, const struct remote *remote) {
    int error = create(mirror, remote);

    if (!error)
        error = form_of_item(mirror->item, &mirror->form);
    if (!error && mirror->form->message_size != remote->message_size)
        error = -EPROTO;
    if (!error)
        error = subscribe(mirror, remote);
    if (error)
        close_mirror(mirror);
    else
        mirror->version = remote->version;
    mirror->machine = remote->machine;
    mirror->read = ddx_time_now();
    return error;
}

static struct mirror *find_mirror(struct mirrors *mirrors, const char *name) {
    struct mirror *mirror = mirrors->first;

    while (mirror && strcmp(mirror->name, name))
        mirror = mirror->next;
    return mirror;
}

static struct mirror *add(struct mirrors *mirrors, const char *name) {
    struct mirror *mirror = calloc(1, sizeof *mirror);

    if (!mirror)
        return NULL;
    mirror->catalog = mirrors->catalog;
    strcpy(mirror->name, name);
    mirror->next = mirrors->first;
    mirrors->first = mirror;
    return mirror;
}

int mirrors_want(struct mirrors *mirrors, const char *name) {
    const struct remote *remote;
    int error = strlen(name) > DDX_NAME_MAX ? -EINVAL : directory_find(mirrors->catalog->directory, name, &remote);

    if (error || !remote)
        return error;
    if (remote->message_size > MESSAGE_MAX)
        return -EFBIG;
    struct mirror *mirror = find_mirror(mirrors, name);
    if (!mirror && !(mirror = add(mirrors, name)))
        return -ENOMEM;
    if (mirror->version != remote->version) {
        close_mirror(mirror);
        return open_mirror(mirror, remote);
    }
    mirror->read = ddx_time_now();
    return mirror->reader ? 0 : subscribe(mirror, remote);
}

/* Follow the origin's announcement. False: the item has had no reader here for UNREAD_NS. */
static bool look_at(struct mirror *mirror, int64_t now) {
    const struct remote *remote;

    if (mirror->version && ddx_store_readers(mirror->item) > 0)
        mirror->read = now;
    if (now - mirror->read >= UNREAD_NS)
        return false;
    bool known = !directory_find(mirror->catalog->directory, mirror->name, &remote);
    if (mirror->version && known && remote->version != mirror->version)
        mirrors_want(mirror->catalog->mirrors, mirror->name);
    else if (mirror->version && known && !mirror->reader)
        subscribe(mirror, remote);
    return true;
}

void mirrors_look(struct mirrors *mirrors, const struct ddx_item_info *items, unsigned count) {
    int64_t now = ddx_time_now();

    for (unsigned i = 0; i < count; i++) /* items of a previous catalog, or read again after a pause */
        if (strchr(items[i].name, ':') && items[i].readers && !items[i].writer_pid &&
            !find_mirror(mirrors, items[i].name))
            mirrors_want(mirrors, items[i].name);

    for (struct mirror **at = &mirrors->first; *at;) {
        struct mirror *mirror = *at;

        if (look_at(mirror, now)) {
            at = &mirror->next;
            continue;
        }
        *at = mirror->next; /* the store keeps the item, with its last value */
        close_mirror(mirror);
        free(mirror);
    }
}

struct mirrors *mirrors_open(struct catalog *catalog) {
    struct mirrors *mirrors = calloc(1, sizeof *mirrors);

    if (mirrors)
        mirrors->catalog = catalog;
    return mirrors;
}

void mirrors_close(struct mirrors *mirrors) {
    while (mirrors && mirrors->first) {
        struct mirror *mirror = mirrors->first;

        mirrors->first = mirror->next;
        close_mirror(mirror);
        free(mirror);
    }
    free(mirrors);
}
