/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <string.h>
#include <sys/mman.h>

#include "files.h"
#include "server.h"

struct item *item_find(const char *name) {
    for (struct item *item = store->items; item; item = item->next)
        if (!strcmp(item->name, name))
            return item;
    return NULL;
}

struct item *item_add(const char *name, const char *type, const struct ddx_layout *layout) {
    struct item *item = kept_allocate(sizeof *item), **link = &store->items;

    if (!item || (layout && !(item->layout = store_layout(layout)))) {
        kept_free(item);
        return NULL;
    }
    strcpy(item->name, name);
    strcpy(item->type, type);
    item->notice_fd = -1;
    while (*link && strcmp((*link)->name, name) < 0)
        link = &(*link)->next;
    item->next = *link;
    *link = item;
    DDX_PASS(STORE_ITEM);
    return item;
}

bool item_is_awaited(const struct item *item) {
    return !*item->type;
}

int item_define(struct item *item, const char *type, const struct ddx_layout *layout) {
    kept_free(item->layout);
    item->layout = store_layout(layout);
    if (!item->layout)
        return -ENOMEM;
    strcpy(item->type, type);
    DDX_PASS(STORE_ITEM);
    return 0;
}

void item_drop_if_unused(struct item *item) {
    struct item **link = &store->items;

    if (item->handles || item->epoch || item->pending)
        return;
    while (*link != item)
        link = &(*link)->next;
    *link = item->next;
    retired_forget(item);
    if (item->notice)
        munmap(item->notice, sizeof *item->notice);
    if (item->notice_fd >= 0)
        file_close(item->notice_fd);
    kept_free(item->layout);
    kept_free(item);
    DDX_PASS(STORE_DROPPED);
}

int item_set_notice(struct item *item, int fd) {
    struct ddx_notice *notice = ddx_memory_map(fd, sizeof *notice, true);

    if (!notice) {
        file_close(fd);
        return -ENOMEM;
    }
    if (item->notice)
        munmap(item->notice, sizeof *item->notice);
    if (item->notice_fd >= 0)
        file_close(item->notice_fd);
    item->notice = notice;
    item->notice_fd = fd;
    item->announced = item->taken = atomic_load(&notice->version);
    readers_count(item);
    return 0;
}

static uint64_t control_bytes(void) {
    return ddx_page_round(sizeof(struct ddx_control));
}

static uint64_t epoch_bytes(const struct epoch *epoch) {
    return epoch ? control_bytes() + epoch->slots * epoch->runs.file_bytes : 0;
}

uint64_t item_bytes(const struct item *item) {
    uint64_t pages = item->readers + (item->notice ? 1 : 0);

    return epoch_bytes(item->epoch) + epoch_bytes(item->pending) + pages * ddx_page_round(1);
}

uint64_t item_reserved(const struct item *item) {
    const struct epoch *epoch = item->pending ? item->pending : item->epoch;
    uint64_t next = epoch ? control_bytes() + ddx_page_round(1) + (2 + item->kept) * epoch->runs.file_bytes : 0;
    uint64_t now = item_bytes(item), then = now + next, ended = retired_bytes(item);

    /* While a new writer prepares its epoch, the reservation is in use; the new files may be larger than the old ones,
     * and then there must be room for the next. */
    if (item->pending && item->epoch)
        then -= epoch_bytes(item->epoch);
    /* An epoch that somebody has not left yet lies where there is room for the next one. */
    return then > now + ended ? then : now + ended;
}

void item_describe(const struct item *item, struct ddx_message *m) {
    const struct epoch *epoch = item->epoch ? item->epoch : item->pending;
    struct ddx_ring_frame frame;

    memset(m, 0, sizeof *m);
    m->operation = DDX_ITEM;
    strcpy(m->name, item->name);
    strcpy(m->type, item->type);
    m->size = epoch ? epoch->layout->size : item->layout ? item->layout->size : 0;
    m->frame_bytes = epoch ? epoch->runs.file_bytes : 0;
    m->bytes = item_bytes(item);
    m->reserved = item_reserved(item);
    m->frames = epoch ? epoch->slots : 0;
    m->readers = item->readers;
    m->index = item->epochs;
    m->pid = item->writer ? item->writer->pid : 0;
    if (item->epoch && ddx_ring_peek(item->epoch->control, &frame)) {
        m->sequence = frame.sequence;
        m->time = frame.time;
    }
    for (const struct client *c = store->clients; c; c = c->next)
        if (reader_of(c, item)) {
            uint64_t missed = (uint64_t)atomic_load(&c->pin->missed_high) << 32 | atomic_load(&c->pin->missed_low);

            if (missed > m->missed)
                m->missed = missed;
        }
}

void item_send_slot(const struct item *item, const struct epoch *epoch, unsigned slot, struct client *to,
                    uint32_t flags) {
    struct ddx_message message = {.operation = DDX_SLOT, .epoch = epoch->number, .index = slot, .flags = flags};

    strcpy(message.name, item->name);
    client_send(to, &message, NULL, &epoch->slot_fd[slot], 1);
}

void item_send_new_slots(const struct item *item, struct epoch *epoch, struct client *writer) {
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        if (epoch->slot_fd[i] >= 0 && !epoch->slot_told[i]) {
            item_send_slot(item, epoch, i, writer, DDX_FLAG_WRITER);
            epoch->slot_told[i] = true;
        }
}

void item_send_epoch(const struct item *item, struct client *reader) {
    struct epoch *epoch = item->epoch;
    struct ddx_message message = {.operation = DDX_EPOCH, .epoch = epoch->number};
    struct ddx_ring_frame frame;

    strcpy(message.name, item->name);
    strcpy(message.type, item->type); /* news for who awaited the item */
    message.sequence = ddx_ring_peek(epoch->control, &frame) ? frame.sequence : 0;
    if (message.sequence < item->sequence) /* of what was published in the one before, not all may be left */
        message.sequence = item->sequence;
    message.missed = item->sequence;
    message.frames = reader->keep;
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        message.index += epoch->slot_ready[i];
    if (epoch->readers_fd < 0 && (epoch->readers_fd = ddx_memory_share(epoch->control_fd)) < 0) {
        note("%s: %d cannot be told of it: %s; closing its connection", item->name, (int)reader->pid, strerror(errno));
        reader->gone = true;
        return;
    }
    client_send(reader, &message, epoch->layout, &epoch->readers_fd, 1);
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        if (epoch->slot_ready[i])
            item_send_slot(item, epoch, i, reader, DDX_FLAG_READER);
}

void item_announce(struct item *item, struct client *reader) {
    struct ddx_message message = {.operation = DDX_READER, .index = reader->id, .frames = reader->keep,
                                  .size = ddx_memory_number(reader->pin_fd)};

    if (++item->announced == 0)
        item->announced = 1; /* 0 in the message means: no change */
    message.sequence = reader->version = item->announced;
    client_send(item->writer, &message, NULL, &reader->pin_fd, 1);
    DDX_PASS(STORE_ANNOUNCED);
}
