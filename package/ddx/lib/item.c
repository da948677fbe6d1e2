/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "roles.h"

#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "ddx.h"

/* Opening and closing: the store, and handles on items. */

#define OPEN_STEP_NS 20000000 /* between attempts to reach the store */

int ddx_local_open(int port, int64_t deadline, DDX_STORE_ID **id) {
    int probe;

    while ((probe = ddx_connect(port ? port : DDX_STORE_PORT)) < 0) {
        struct timespec step = {0, OPEN_STEP_NS};

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

/* ---- Facts on items ---- */

/* Information about items and the store. */

static int make_fields(DDX_STORE_ITEM *item) {
    const struct ddx_layout *layout = item->layout;

    if (item->fields || !layout->field_count)
        return 0;
    item->fields = calloc(layout->field_count, sizeof *item->fields);
    if (!item->fields)
        return -ENOMEM;
    for (unsigned i = 0; i < layout->field_count; i++) {
        const struct ddx_layout_field *f = &layout->field[i];

        item->fields[i] = (struct ddx_field){
            f->name, (enum ddx_kind)f->kind, f->bytes, f->count, f->offset, f->used, f->children, f->extent};
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

/* Get the next message on this connection, within DDX_ANSWER_NS; *heard: number of the last message. */
static int next(int socket, struct ddx_packet *packet, uint64_t *heard) {
    int64_t deadline = ddx_time_now() + DDX_ANSWER_NS;
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

/* ---- Errors ---- */

const char *ddx_error_text(int error) {
    switch (abs(error)) {
    case 0: return "no error";
    case ECONNREFUSED: return "no store runs here; start one with: ddxstore -m 8M";
    case ENOENT: return "the store has no item of this name; see: ddxctl list";
    case EPERM: return "the store's socket or its folder may be another user's; see DDX_DIR in ddx.h";
    case EPROTOTYPE: return "the item has another type, or one that the program has not declared";
    case EMSGSIZE:
        return "wrong size: the item's value does not fit the program's struct; if the struct has changed, first stop "
               "the programs that have the item open";
    case EEXIST: return "another program writes this item already";
    case ENOSPC: return "the store's memory budget is used up; give it more with: ddxstore -m";
    case EBUSY: return "no memory left for another reader, or a frame is still held";
    case ENOBUFS: return "every frame of the item is held, nothing was written";
    case EMFILE: return "too few descriptors: one is needed for each frame and each reader of an item; see ulimit -n";
    case ETIMEDOUT: return "nothing was written within the timeout";
    case EINVAL: return "bad argument, or a type that cannot be shared (ddx_type_problem() names the word)";
    case EOPNOTSUPP: return "no catalog runs here, through which other machines are reached; start one with: catalog";
    case EHOSTUNREACH: return "no machine of this name is known to the catalog; check its catalog, and the network";
    case EFBIG: return "its values are too large to be sent to other machines (16 MiB at most)";
    case ENOMEM: return "out of memory";
    case EDQUOT: return "this program has more items open than the store allows one program; close some of them";
    default: return strerror(abs(error));
    }
}
