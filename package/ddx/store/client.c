/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include "files.h"
#include "holder.h"
#include "server.h"

#define MESSAGES_AT_ONCE 64 /* then the others get their turn */
#define QUEUED_MAX 1024     /* messages for one client: more than there are frames and readers of an item */

/*
 * One process gets a quarter of our descriptors at most, and all connections together three quarters: the rest is for
 * memory files. Descriptors are given out from below, so the newest one tells how many there are.
 */
static bool too_many(int socket, int32_t pid) {
    struct rlimit limit;
    rlim_t its = 0;

    if (getrlimit(RLIMIT_NOFILE, &limit))
        return false;
    for (const struct client *client = store->clients; client; client = client->next)
        its += client->pid == pid;
    return its >= limit.rlim_cur / 4 || (rlim_t)socket >= limit.rlim_cur / 4 * 3;
}

bool client_holds_too_much(const struct client *client) {
    struct rlimit limit;
    rlim_t its = 0;

    if (getrlimit(RLIMIT_NOFILE, &limit))
        return false;
    for (const struct client *c = store->clients; c; c = c->next)
        if (c->pid == client->pid)
            its += c->queue.files + (c->offered ? c->offered->slots + 1 : 0) + (c->offered_notice_fd >= 0) +
                   (c->offered_pin_fd >= 0);
    return its >= limit.rlim_cur / 4 && its > DDX_SLOTS_MAX + DDX_FDS_MAX + 1;
}

struct client *client_add(int socket) {
    struct client *client = kept_allocate(sizeof *client);
    struct ucred who = {0};
    socklen_t length = sizeof who;

    getsockopt(socket, SOL_SOCKET, SO_PEERCRED, &who, &length);
    if (!client || too_many(socket, who.pid)) {
        note("%d is refused: too many connections", (int)who.pid);
        kept_free(client);
        close(socket);
        return NULL;
    }
    client->pid = who.pid;
    client->socket = socket;
    client->pin_fd = client->offered_notice_fd = client->offered_pin_fd = -1;
    client->next = store->clients;
    store->clients = client;
    DDX_PASS(STORE_CLIENT);
    return client;
}

void client_send(struct client *client, const struct ddx_message *message, const struct ddx_layout *layout,
                 const int *fds, unsigned count) {
    if (client->gone)
        return;
    if (message->operation == DDX_EPOCH)
        ddx_queue_drop_epoch(&client->queue);
    int result = ddx_queue_put(&client->queue, message, layout, fds, count);
    if (client->queue.count > QUEUED_MAX)
        note("%d asks and does not listen; closing its connection", (int)client->pid);
    else if (result)
        note("what %d is to hear cannot be kept (%s); closing its connection", (int)client->pid, strerror(-result));
    client->gone |= result || client->queue.count > QUEUED_MAX;
}

/* For tests: at what point others know. */
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
        return; /* or its claim has failed, and the notice is another one's */
    /* Only now that the news is in its socket: a writer that sees the new version finds it there, without waiting. And
     * never back: what is said a second time, since a worker has died, was followed by more. */
    ddx_word *version = &client->item->notice->version;
    if ((int32_t)((uint32_t)message->sequence - atomic_load(version)) > 0)
        atomic_store(version, (uint32_t)message->sequence);
    DDX_PASS(STORE_NOTICED);
}

/* Whether there was anything to be said to it. */
static bool go_on(struct client *client) {
    if (!client->queue.count || client->gone)
        return false;
    if (ddx_queue_go_on(&client->queue, client->socket, sent, client))
        client->gone = true;
    else if (client->queue.files && client_holds_too_much(client)) {
        note("%d does not listen, and others need descriptors, too; closing a connection", (int)client->pid);
        client->gone = true;
    }
    return true;
}

bool clients_go_on(struct client *last) {
    bool any = false;

    /* Writers first: others wait for what they answer. */
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

/* After a restart, newcomers wait until living holders have reported, or they would find items missing. */
static bool too_early(struct client *client) {
    uint32_t operation = 0;

    if (!settings.restarted || store->open || client->item)
        return false;
    ssize_t got = recv(client->socket, &operation, sizeof operation, MSG_PEEK | MSG_DONTWAIT);
    return got > 0 && (operation == DDX_OPEN || operation == DDX_LIST);
}

void client_receive(struct client *client) {
    static struct ddx_packet packet;

    for (int i = 0; i < MESSAGES_AT_ONCE && !client->gone; i++) {
        client->early = too_early(client);
        if (client->early)
            return;
        int result = ddx_peek(client->socket, &packet);
        if (result == 0)
            return;
        if (result < 0) {
            if (result == -EPROTO)
                note("%d sent nonsense; closing its connection", (int)client->pid);
            client->gone = true;
            return;
        }
        /* A worker may have done this, and died before it took it off. */
        if (!packet.message.number || packet.message.number > client->handled) {
            holder_serving(client->socket);
            store->current = client;
            request_handle(client, &packet);
            store->current = NULL;
            client->handled = packet.message.number ? packet.message.number : client->handled;
            DDX_PASS(STORE_HANDLED);
            store_commit();
            holder_serving(-1);
        }
        ddx_packet_close(&packet);
        ddx_discard(client->socket);
        DDX_PASS(STORE_DISCARDED);
        store_say(packet.message.status ? NULL : client); /* who complains is told first what comes of it */
    }
}

/* What it held is free again. */
static void detach(struct client *client) {
    struct item *item = client->item;

    client->gone = true;
    if (!item)
        return;
    DDX_PASS(STORE_GONE);
    writer_left(client);
    reader_left(client);
    client->item = NULL;
    item->handles--;
    item_drop_if_unused(item);
}

void clients_reap(void) {
    for (struct client *client = store->clients; client; client = client->next) {
        struct pollfd look = {.fd = client->socket};

        if (client != store->current && (client->gone || (poll(&look, 1, 0) > 0 && look.revents & (POLLHUP | POLLERR))))
            detach(client);
    }
}

void clients_sweep(void) {
    struct client **link = &store->clients;

    while (*link) {
        struct client *client = *link;

        if (client->gone) {
            *link = client->next;
            detach(client);
            shutdown(client->socket, SHUT_RDWR); /* or the next worker might take it for one that has just come */
            offer_abandon(client);
            ddx_queue_clear(&client->queue);
            file_close(client->socket);
            kept_free(client);
            link = &store->clients; /* forgetting one may have found out that another is gone, too */
        } else
            link = &client->next;
    }
}
