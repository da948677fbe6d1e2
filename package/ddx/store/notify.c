/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <string.h>

#include "../lib/fault.h"
#include "epoch.h"
#include "items.h"
#include "log.h"
#include "notify.h"
#include "send.h"

static void send_slot(const struct item *item, const struct epoch *epoch, unsigned slot, struct client *to,
                      uint32_t flags) {
    struct ddx_message message = {.operation = DDX_SLOT, .epoch = epoch->number, .index = slot, .flags = flags};

    strcpy(message.name, item->name);
    client_send(to, &message, NULL, &epoch->slot_fd[slot], 1);
}

void notify_slots(const struct item *item, struct epoch *epoch, struct client *writer) {
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        if (epoch->slot_fd[i] >= 0 && !epoch->slot_told[i]) {
            send_slot(item, epoch, i, writer, DDX_FLAG_WRITER);
            epoch->slot_told[i] = true;
        }
}

void notify_epoch(const struct item *item, struct client *reader) {
    struct epoch *epoch = item->epoch;
    struct ddx_message message = {.operation = DDX_EPOCH, .epoch = epoch->number};
    struct ddx_ring_frame frame;

    strcpy(message.name, item->name);
    strcpy(message.type, item->type); /* new to clients that awaited the item */
    message.sequence = ddx_ring_peek(epoch->control, &frame) ? frame.sequence : 0;
    if (message.sequence < item->sequence) /* the last frame of the former epoch may not have been carried over */
        message.sequence = item->sequence;
    message.missed = item->sequence;
    message.frames = reader->keep;
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        message.index += epoch->slot_ready[i];
    if (epoch->readers_fd < 0 && (epoch->readers_fd = ddx_memory_share(epoch->control_fd)) < 0) {
        log_line("%s: %d cannot be notified: %s; closing its connection", item->name, (int)reader->pid,
                 strerror(errno));
        reader->gone = true;
        return;
    }
    client_send(reader, &message, epoch->layout, &epoch->readers_fd, 1);
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        if (epoch->slot_ready[i])
            send_slot(item, epoch, i, reader, DDX_FLAG_READER);
}

void notify_reader(struct item *item, struct client *reader) {
    struct ddx_message message = {.operation = DDX_READER, .index = reader->id, .frames = reader->keep,
                                  .size = ddx_memory_number(reader->pin_fd)};

    if (++item->announced == 0)
        item->announced = 1; /* 0 in the message means: no change */
    message.sequence = reader->version = item->announced;
    client_send(item->writer, &message, NULL, &reader->pin_fd, 1);
    DDX_PASS(STORE_ANNOUNCED);
}

void notify_readers(struct item *item) {
    for (struct client *c = NULL; (c = item_next_reader(item, c));)
        notify_reader(item, c);
}

void notify_epoch_to_all(const struct item *item) {
    for (struct client *c = NULL; (c = item_next_reader(item, c));)
        if (c->admitted)
            notify_epoch(item, c);
}

void notify_slot_to_all(const struct item *item, unsigned slot) {
    for (struct client *c = NULL; (c = item_next_reader(item, c));)
        if (c->admitted)
            send_slot(item, item->epoch, slot, c, DDX_FLAG_READER);
}

void readers_count(struct item *item) {
    const struct epoch *epoch = item->epoch;
    bool kept = epoch && epoch_ready(epoch) && epoch->slots >= 2 + item->keep_total;
    uint32_t count = 0;

    for (struct client *c = NULL; (c = item_next_reader(item, c));)
        if (c->admitted) {
            c->counted |= kept;
            count += c->counted;
        }
    item->counted = count;
}

void readers_tell(const struct store *store) {
    for (const struct item *item = store->items; item; item = item->next)
        if (item->notice && atomic_load_explicit(&item->notice->readers, memory_order_relaxed) != item->counted)
            atomic_store(&item->notice->readers, item->counted);
}
