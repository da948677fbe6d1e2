/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "items.h"

#include <errno.h>
#include <fnmatch.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EXTENTS_MAX 16
#define CLEARED_MAX (64u << 10) /* the padding of smaller values is zeroed */

static void refuse(struct replay_item *item, int error) {
    if (!item->refused)
        say("%s: %s; it is not replayed%s", item->name, ddx_error_text(error),
            error == -EEXIST ? " (-prefix gives the items other names)" : "");
    item->refused = true;
}

/* Create an item of a type of which only the size is known. */
static int create_opaque(struct replay *replay, struct replay_item *item, const char *type, size_t size) {
    void *data;

    item->handle = ddx_store_lookup_item(replay->id, item->name, type, (int)size);
    if (!item->handle)
        return -errno;
    int error = ddx_store_loan(item->handle, &data); /* become its writer */
    return error ? error : ddx_store_cancel(item->handle);
}

static int create(struct replay *replay, struct replay_item *item, const struct mcap_channel *channel, size_t size) {
    const char *type = mcap_value(channel, "ddx.type"), *declaration = mcap_value(channel, "ddx.declaration");
    const char *words = mcap_value(channel, "ddx.extents");
    struct ddx_extent extents[EXTENTS_MAX];
    char *text = strdup(words ? words : "");

    if (!text)
        return -ENOMEM;
    ddx_store_done_item(item->handle);
    form_free(item->form);
    item->handle = NULL;
    item->form = NULL;
    item->channel = 0;
    int error;
    if (*declaration) {
        struct ddx_item_spec spec = {.name = item->name, .type = type, .declaration = declaration, .extents = extents};

        spec.extent_count = form_list_extents(text, extents, EXTENTS_MAX);
        error = ddx_store_create(replay->id, &spec, &item->handle);
    } else {
        error = size > FORM_HEADER ? create_opaque(replay, item, type, size - FORM_HEADER) : -EINVAL;
    }
    free(text);
    if (!error)
        error = form_of_item(item->handle, &item->form);
    if (!error)
        item->channel = channel->id;
    return error;
}

static struct replay_item *find(struct replay *replay, const struct mcap_channel *channel) {
    struct replay_item **link = &replay->items;

    for (; *link; link = &(*link)->next)
        if (!strcmp((*link)->topic, channel->topic))
            return *link;
    struct replay_item *item = calloc(1, sizeof *item);
    if (!item)
        return NULL;
    item->topic = channel->topic;
    if (snprintf(item->name, sizeof item->name, "%s%s", replay->prefix, item->topic) >= (int)sizeof item->name) {
        item->name[DDX_NAME_MAX] = 0;
        refuse(item, -EINVAL);
    }
    return *link = item;
}

static bool is_excepted(const struct replay *replay, const char *topic) {
    char pattern[DDX_NAME_MAX + 1];

    for (const char *at = replay->except; at && *at;) {
        size_t length = strcspn(at, ",");

        snprintf(pattern, sizeof pattern, "%.*s", (int)(length > DDX_NAME_MAX ? DDX_NAME_MAX : length), at);
        if (!fnmatch(pattern, topic, 0))
            return true;
        at += length + (at[length] == ',');
    }
    return false;
}

static bool is_ours(const struct replay *replay, const struct mcap_channel *channel) {
    return channel && mcap_value(channel, "ddx.type") && mcap_value(channel, "ddx.declaration") &&
           !is_excepted(replay, channel->topic);
}

unsigned items_create(struct replay *replay) {
    unsigned count = 0;

    for (unsigned id = 1; id < 65536; id++) {
        const struct mcap_channel *channel = mcap_channel(replay->reader, (uint16_t)id);
        struct replay_item *item = is_ours(replay, channel) ? find(replay, channel) : NULL;

        if (!item || item->channel || item->refused)
            continue;
        count++;
        int error = *mcap_value(channel, "ddx.declaration") ? create(replay, item, channel, 0) : 0;
        if (error)
            refuse(item, error);
    }
    return count;
}

void items_free(struct replay *replay) {
    for (struct replay_item *item = replay->items, *next; item; item = next) {
        next = item->next;
        ddx_store_done_item(item->handle);
        form_free(item->form);
        free(item);
    }
}

static int write_value(const struct replay_item *item, const struct mcap_message *message, int64_t time) {
    void *data;

    if (message->size != item->form->message_size)
        return -EMSGSIZE;
    int error = ddx_store_loan(item->handle, &data);
    if (error)
        return error;
    if (item->form->item_size <= CLEARED_MAX && !*item->form->extents)
        memset(data, 0, (size_t)item->form->item_size);
    form_unpack(item->form, message->data, data);
    return ddx_store_publish(item->handle, &time);
}

struct replay_item *items_write(struct replay *replay, const struct mcap_message *message, int64_t time, int *error) {
    const struct mcap_channel *channel = mcap_channel(replay->reader, message->channel);
    struct replay_item *item = is_ours(replay, channel) ? find(replay, channel) : NULL;

    *error = 0;
    if (!item)
        return NULL;
    if (item->refused) {
        *error = -EEXIST;
        return NULL;
    }
    if (item->channel != channel->id)
        *error = create(replay, item, channel, message->size);
    if (!*error && replay->patient)
        program_wait_for_room(item->handle, &replay->patient, replay->book);
    if (!*error)
        *error = write_value(item, message, time);
    while (program_try_again(*error, replay->book)) /* a replay can wait */
        *error = write_value(item, message, time);
    if (*error) {
        refuse(item, *error);
        return NULL;
    }
    return item;
}

int items_readers(const struct replay *replay) {
    int least = INT32_MAX;

    for (const struct replay_item *item = replay->items; item; item = item->next) {
        int readers = item->handle && !item->refused ? ddx_store_readers(item->handle) : INT32_MAX;

        if (readers < least)
            least = readers;
    }
    return least;
}
