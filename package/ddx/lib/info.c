/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Information about items and the store. */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "receive.h"
#include "connection.h"

static int make_fields(DDX_STORE_ITEM *item) {
    const struct ddx_layout *layout = item->layout;

    if (item->fields || !layout->field_count)
        return 0;
    item->fields = calloc(layout->field_count, sizeof *item->fields);
    if (!item->fields)
        return -ENOMEM;
    for (unsigned i = 0; i < layout->field_count; i++) {
        const struct ddx_layout_field *f = &layout->field[i];

        item->fields[i] = (struct ddx_field){f->name,   (enum ddx_kind)f->kind, f->bytes,    f->count,
                                             f->offset, f->used,                f->children, f->extent};
    }
    return 0;
}

/* The layout of the frames that this handle sees now. */
static int refresh(DDX_STORE_ITEM *item) {
    const struct ddx_term *term = item->writer.term ? item->writer.term : item->reader.term;
    int result = term ? ddx_item_set_layout(item, term->layout) : 0;

    return result ? result : make_fields(item);
}

const struct ddx_field *ddx_store_field(const DDX_STORE_ITEM *item, unsigned index) {
    DDX_STORE_ITEM *handle = (DDX_STORE_ITEM *)(uintptr_t)item; /* the first call makes the table of fields */
    const struct ddx_field *field = NULL;

    if (!handle)
        return NULL;
    ddx_lock_take(&handle->lock);
    if (!refresh(handle) && index < handle->layout->field_count)
        field = &handle->fields[index];
    ddx_lock_give(&handle->lock);
    return field;
}

const struct ddx_field *ddx_store_field_named(const DDX_STORE_ITEM *item, const char *name) {
    DDX_STORE_ITEM *handle = (DDX_STORE_ITEM *)(uintptr_t)item;
    const struct ddx_field *field = NULL;

    if (!handle || !name)
        return NULL;
    ddx_lock_take(&handle->lock);
    if (!refresh(handle))
        for (unsigned i = 0; i < handle->layout->field_count && !field; i++)
            if (!strcmp(handle->fields[i].name, name))
                field = &handle->fields[i];
    ddx_lock_give(&handle->lock);
    return field;
}

uint32_t ddx_store_layout(const DDX_STORE_ITEM *item) {
    DDX_STORE_ITEM *handle = (DDX_STORE_ITEM *)(uintptr_t)item;
    uint32_t number = 0;

    if (!handle)
        return 0;
    ddx_lock_take(&handle->lock);
    if (!refresh(handle))
        number = handle->layouts;
    ddx_lock_give(&handle->lock);
    return number;
}

const char *ddx_store_item_name(const DDX_STORE_ITEM *item) {
    return item ? item->name : NULL;
}
const char *ddx_store_item_type(const DDX_STORE_ITEM *item) {
    return item ? item->type : NULL;
}

static void fill(struct ddx_item_info *info, const struct ddx_message *m) {
    memset(info, 0, sizeof *info);
    strcpy(info->name, m->name);
    strcpy(info->type, m->type);
    info->size = m->size;
    info->frame_bytes = m->frame_bytes;
    info->bytes = m->bytes;
    info->reserved = m->reserved;
    info->sequence = m->sequence;
    info->time = m->time;
    info->frames = m->frames;
    info->readers = m->readers;
    info->epoch = m->index;
    info->writer_pid = m->pid;
    info->missed_max = m->missed;
}

int ddx_store_item_info(DDX_STORE_ITEM *item, struct ddx_item_info *info) {
    struct ddx_message message;

    if (!item || !info)
        return -EINVAL;
    ddx_lock_take(&item->lock);
    ddx_message_init(&message, DDX_INFO, item);
    int result = ddx_item_request(item, &message, NULL, DDX_ITEM);
    if (!result)
        fill(info, &item->reply);
    ddx_lock_give(&item->lock);
    return result;
}

/* Get the next message on this connection, within DDX_ANSWER_WAIT; *heard: number of the last message. */
static int next(int socket, struct ddx_packet *packet, uint64_t *heard) {
    int64_t deadline = ddx_time_now() + DDX_ANSWER_WAIT;
    int result;

    while ((result = ddx_receive(socket, packet)) == 0 || (result > 0 && packet->message.number <= *heard)) {
        struct pollfd wait = {.fd = socket, .events = POLLIN};
        int64_t left = deadline - ddx_time_now();

        if (left <= 0)
            return -ECONNREFUSED;
        poll(&wait, 1, (int)(left / 1000000) + 1);
    }
    if (result <= 0)
        return -ECONNREFUSED;
    *heard = packet->message.number;
    ddx_packet_close(packet);
    return 0;
}

static int by_name(const void *a, const void *b) {
    return strcmp(((const struct ddx_item_info *)a)->name, ((const struct ddx_item_info *)b)->name);
}

static int collect(int socket, struct ddx_packet *packet, struct ddx_store_info *store, struct ddx_item_info **items,
                   unsigned *count) {
    struct ddx_message message = {.operation = DDX_LIST, .number = 1};
    const struct ddx_message *m = &packet->message;
    uint64_t heard = 0;
    int result = ddx_send(socket, &message, NULL, NULL, 0);

    while (!result && !(result = next(socket, packet, &heard)) && m->operation == DDX_ITEM) {
        struct ddx_item_info *more = realloc(*items, (*count + 1) * sizeof **items);

        if (!more)
            return -ENOMEM;
        *items = more;
        fill(&more[(*count)++], m);
    }
    if (!result && store)
        *store = (struct ddx_store_info){m->size, m->bytes, m->reserved, *count, m->readers, m->pid, m->index};
    return result ? -ECONNREFUSED : 0;
}

int ddx_store_list(DDX_STORE_ID *id, struct ddx_store_info *store, struct ddx_item_info **items, unsigned *count) {
    if (!id || !items || !count)
        return -EINVAL;
    *items = NULL;
    *count = 0;
    int socket = ddx_connect(id->port);
    if (socket < 0)
        return socket == -EPERM ? -ECONNREFUSED : socket; /* the true store may come back */
    struct ddx_packet *packet = malloc(sizeof *packet);
    int result = packet ? collect(socket, packet, store, items, count) : -ENOMEM;
    free(packet);
    close(socket);
    if (result) {
        free(*items);
        *items = NULL;
        *count = 0;
    } else if (*count)
        qsort(*items, *count, sizeof **items, by_name);
    return result;
}
