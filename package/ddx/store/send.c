/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "send.h"

#include <errno.h>
#include <string.h>
#include <sys/resource.h>

#include "../lib/fault.h"
#include "checkpoint.h"
#include "epoch.h"
#include "items.h"
#include "log.h"

#define QUEUED_MAX 1024 /* messages for one client: more than an item has frames and readers */

bool client_holds_too_much(const struct client *client) {
    struct rlimit limit;
    rlim_t its = 0;

    if (getrlimit(RLIMIT_NOFILE, &limit))
        return false;
    for (const struct client *c = client->store->clients; c; c = c->next)
        if (c->process == client->process)
            its += c->queue.files + (c->offered ? c->offered->slots + 1 : 0) + (c->offered_notice_fd >= 0) +
                   (c->offered_pin_fd >= 0);
    return its >= limit.rlim_cur / 4 && its > DDX_SLOTS_MAX + DDX_FDS_MAX + 1;
}

void client_send(struct client *client, const struct ddx_message *message, const struct ddx_layout *layout,
                 const int *fds, unsigned count) {
    if (client->gone)
        return;
    if (message->operation == DDX_EPOCH)
        ddx_queue_drop_epoch(&client->queue);
    struct checkpoint_payer before =
        checkpoint_charge(&client->process->account, CHECKPOINT_SHARE + CHECKPOINT_ANSWERS);
    int result = ddx_queue_put(&client->queue, message, layout, fds, count);

    checkpoint_charge(before.account, before.most);
    if (client->queue.count > QUEUED_MAX)
        log_line("%d sends requests and reads no answers; closing its connection", (int)client->pid);
    else if (result)
        log_line("no memory for messages to %d (%s); closing its connection", (int)client->pid, strerror(-result));
    client->gone |= result || client->queue.count > QUEUED_MAX;
}

/* For tests: fault points of sent messages. */
static void pass_said(const struct ddx_message *message, const struct item *item) {
    bool to_reader = message->flags & DDX_FLAG_READER, to_writer = message->flags & DDX_FLAG_WRITER;

    (void)item, (void)to_reader, (void)to_writer;
    if (message->status)
        return; /* a refusal */
    switch (message->operation) {
    case DDX_CLAIMED: DDX_PASS(STORE_CLAIMED); break;
    case DDX_DONE: DDX_PASS(STORE_GRANTED); break;
    case DDX_EPOCH: DDX_PASS(STORE_EPOCH_BEGUN); break;
    case DDX_ATTACHED: DDX_PASS(STORE_ATTACHED); break;
    case DDX_READER_GONE: DDX_PASS(STORE_READER_TOLD); break;
    case DDX_OFFERED: DDX_PASS(STORE_ACCEPTED); break;
    case DDX_SLOT:
        if (to_reader && to_writer)
            DDX_PASS(STORE_SLOT_TOLD);
        else if (to_reader)
            DDX_PASS(STORE_EPOCH);
        else if (item && item->pending)
            DDX_PASS(STORE_SLOTS);
        else
            DDX_PASS(STORE_ROOM_TOLD);
        break;
    default: break;
    }
}

static void sent(const struct ddx_message *message, void *context) {
    struct client *client = context;

    pass_said(message, client->item);
    if (message->operation != DDX_READER || client->item->writer != client)
        return; /* its claim has failed, and the notice belongs to another writer */
    /* Only after the message was sent: a writer that sees the new version must find it in its socket without waiting.
     * The version never decreases: a message that is repeated after a worker's death was followed by later ones. */
    ddx_word *version = &client->item->notice->version;
    if ((int32_t)((uint32_t)message->sequence - atomic_load(version)) > 0)
        atomic_store(version, (uint32_t)message->sequence);
    DDX_PASS(STORE_NOTICED);
}

/* Whether a message was waiting for the client. */
static bool go_on(struct client *client) {
    if (!client->queue.count || client->gone)
        return false;
    if (ddx_queue_go_on(&client->queue, client->socket, sent, client))
        client->gone = true;
    else if (client->queue.files && client_holds_too_much(client)) {
        log_line("%d reads no messages, and others need its descriptors; closing a connection", (int)client->pid);
        client->gone = true;
    }
    return true;
}

bool clients_go_on(struct store *store, struct client *last) {
    bool any = false;

    /* Writers first: other clients wait for their answers. */
    for (struct client *client = store->clients; client; client = client->next)
        if (client != last && client->item && client->item->writer == client)
            any |= go_on(client);
    for (struct client *client = store->clients; client; client = client->next)
        if (client != last)
            any |= go_on(client);
    return (last && go_on(last)) || any;
}

void client_reply(struct client *client, uint32_t operation, int status) {
    struct ddx_message message = {.operation = operation, .status = status};

    client_send(client, &message, NULL, NULL, 0);
}

/* ---- Notifications ---- */

/* Notifications to the holders of an item: slots and readers to the writer, epochs and slots to readers. */

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
    struct ddx_message message = {.operation = DDX_READER,
                                  .index = reader->id,
                                  .frames = reader->keep,
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
