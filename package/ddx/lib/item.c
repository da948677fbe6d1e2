/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Opening and closing: the store, and handles on items. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "receive.h"
#include "item.h"
#include "keeper.h"
#include "connection.h"
#include "reader_role.h"
#include "writer.h"
#include "writer_role.h"

#define OPEN_STEP 20000000 /* ns between attempts to reach the store */

int ddx_local_open(int port, int64_t deadline, DDX_STORE_ID **id) {
    int probe;

    while ((probe = ddx_connect(port ? port : DDX_STORE_PORT)) < 0) {
        struct timespec step = {0, OPEN_STEP};

        if (ddx_time_now() >= deadline)
            return probe;
        nanosleep(&step, NULL);
    }
    close(probe);
    *id = calloc(1, sizeof **id);
    if (!*id)
        return -ENOMEM;
    (*id)->port = port ? port : DDX_STORE_PORT;
    return 0;
}

static void item_free(DDX_STORE_ITEM *item) {
    ddx_writer_end(&item->writer);
    ddx_reader_end(&item->reader);
    if (item->socket >= 0) {
        /* While the keeper polls it, close() has no effect; the store must see the end of the handle at once. */
        shutdown(item->socket, SHUT_RDWR);
        close(item->socket);
    }
    ddx_queue_clear(&item->queue);
    free(item->packet);
    free(item->layout);
    free(item->own);
    free(item->fields);
    free(item);
}

/* Make a handle that the store does not know yet. Takes ownership of `own`, also on failure. */
static int item_new(DDX_STORE_ID *id, const char *name, const char *type, struct ddx_layout *own,
                    DDX_STORE_ITEM **result) {
    DDX_STORE_ITEM *item = aligned_alloc(_Alignof(DDX_STORE_ITEM), sizeof *item);

    if (item)
        memset(item, 0, sizeof *item);
    if (!item || !(item->packet = malloc(sizeof *item->packet))) {
        free(item);
        free(own);
        return -ENOMEM;
    }
    item->id = id;
    strcpy(item->name, name);
    strcpy(item->type, type);
    item->own = own;
    item->socket = -1;
    item->reader.keep = 1;
    item->reader.pin_fd = item->reader.hold_fd = item->reader.held = item->reader.shown = item->reader.placed = -1;
    item->writer.loaned = item->writer.notice_fd = item->writer.hold_fd = -1;
    *result = item;
    return 0;
}

/* Introduce the handle to the store. */
static int item_open(DDX_STORE_ITEM *item, uint32_t flags) {
    struct ddx_message message;
    int result = ddx_connection_open(item);

    if (result)
        return result;
    ddx_message_init(&message, DDX_OPEN, item);
    message.flags = flags;
    return ddx_item_request(item, &message, item->own, DDX_OPENED);
}

/* Check that the store's item agrees with the caller's type. 0, or -errno. */
static int agrees(DDX_STORE_ITEM *item, const char *type) {
    struct ddx_span *spans;
    unsigned count;
    int result;

    if (*type && strcmp(type, item->type) != 0)
        return -EPROTOTYPE;
    if (!*item->type) /* awaited */
        return (item->layout = ddx_layout_opaque(0)) ? 0 : -ENOMEM;
    if (!item->own) {
        result = ddx_layout_of(item->type, &item->own);
        if (result == -ENOENT)
            return 0; /* a type that this program has not declared: it gets the item's own struct */
        if (result)
            return result;
    }
    result = ddx_layout_match(item->layout, item->own, &spans, &count);
    if (!result)
        free(spans);
    /* An item that is too large for this program's arrays can still be read with ddx_store_acquire(). */
    return result == -EMSGSIZE && item->layout->field_count && item->own->field_count &&
                   item->layout->size > item->own->size && ddx_layout_extents(item->layout)
               ? 0
               : result;
}

static int lookup(DDX_STORE_ID *id, const char *name, const char *type, int size, uint32_t flags,
                  DDX_STORE_ITEM **item) {
    struct ddx_layout *own = NULL;
    int result = 0;

    if (!id || !name || !ddx_item_name_ok(name) || (type && !ddx_type_name_ok(type)) || (!type && size) || size < 0)
        return -EINVAL;
    if (type) {
        result = ddx_layout_of(type, &own);
        if (result == -ENOENT && size > 0)
            result = (own = ddx_layout_opaque((uint64_t)size)) ? 0 : -ENOMEM;
        if (!result && size > 0 && own->size != (uint64_t)size)
            result = -EMSGSIZE;
        if (result) {
            if (result != -ENOENT)
                free(result == -EMSGSIZE ? own : NULL);
            return result == -ENOENT ? -EINVAL : result;
        }
    }
    result = item_new(id, name, type ? type : "", own, item);
    if (result)
        return result;
    result = item_open(*item, flags);
    if (!result)
        result = agrees(*item, type ? type : "");
    if (!result)
        result = ddx_keeper_add(*item);
    if (result)
        item_free(*item);
    return result;
}

int ddx_local_lookup(DDX_STORE_ID *id, const char *name, const char *type, int size, DDX_STORE_ITEM **item) {
    return lookup(id, name, type, size, type ? DDX_FLAG_CREATE : 0, item);
}

DDX_STORE_ITEM *ddx_store_await_item(DDX_STORE_ID *id, const char *name) {
    DDX_STORE_ITEM *item;
    int result = lookup(id, name, NULL, 0, DDX_FLAG_AWAIT, &item);

    if (!result)
        return item;
    errno = -result;
    return NULL;
}

static int spec_layout(const struct ddx_item_spec *spec, struct ddx_layout **layout) {
    int result = spec->declaration ? ddx_layout_parse(spec->declaration, layout) : ddx_layout_of(spec->type, layout);

    if (result)
        return result == -ENOENT ? -EINVAL : result;
    if (spec->size && spec->size != (*layout)->size)
        result = -EMSGSIZE;
    for (unsigned i = 0; i < spec->extent_count && !result; i++)
        result = ddx_layout_use(*layout, spec->extents[i].field, spec->extents[i].bytes);
    if (!result && ddx_layout_empty(*layout))
        result = -EINVAL;
    if (result)
        free(*layout);
    return result;
}

int ddx_store_create(DDX_STORE_ID *id, const struct ddx_item_spec *spec, DDX_STORE_ITEM **item) {
    struct ddx_layout *layout;

    if (!id || !spec || !item || !spec->name || !ddx_item_name_ok(spec->name) || !spec->type ||
        !ddx_type_name_ok(spec->type))
        return -EINVAL;
    int result = spec_layout(spec, &layout);
    if (result)
        return result;
    DDX_STORE_ITEM *made;
    result = item_new(id, spec->name, spec->type, layout, &made);
    if (result)
        return result;
    result = item_open(made, DDX_FLAG_CREATE | DDX_FLAG_WRITER);
    if (!result && strcmp(made->type, spec->type) != 0)
        result = -EPROTOTYPE;
    if (!result) {
        /* The store's layout may have other extents; this program writes with its own. */
        free(made->layout);
        made->layout = ddx_layout_copy(layout);
        ddx_lock_take(&made->lock);
        result = made->layout ? ddx_writer_claim(made) : -ENOMEM;
        ddx_lock_give(&made->lock);
    }
    if (!result)
        result = ddx_keeper_add(made);
    if (result)
        item_free(made);
    else
        *item = made;
    return result;
}

int ddx_store_done_item(DDX_STORE_ITEM *item) {
    if (item) {
        ddx_keeper_remove(item);
        item_free(item);
    }
    return 0;
}

int ddx_store_close(DDX_STORE_ID *id) {
    if (!id)
        return 0;
    while (id->items)
        ddx_store_done_item(id->items);
    free(id);
    return 0;
}
