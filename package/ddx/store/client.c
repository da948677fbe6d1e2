/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

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
    for (const struct client *client = store.clients; client; client = client->next)
        its += client->pid == pid;
    return its >= limit.rlim_cur / 4 || (rlim_t)socket >= limit.rlim_cur / 4 * 3;
}

bool client_holds_too_much(const struct client *client) {
    struct rlimit limit;
    rlim_t its = 0;

    if (getrlimit(RLIMIT_NOFILE, &limit))
        return false;
    for (const struct client *c = store.clients; c; c = c->next)
        if (c->pid == client->pid)
            its += c->queue.files + (c->offered ? c->offered->slots + 1 : 0) + (c->offered_notice_fd >= 0) +
                   (c->offered_pin_fd >= 0);
    return its >= limit.rlim_cur / 4 && its > DDX_SLOTS_MAX + DDX_FDS_MAX + 1;
}

struct client *client_add(int socket) {
    struct client *client = calloc(1, sizeof *client);
    struct ucred who = {0};
    socklen_t length = sizeof who;

    getsockopt(socket, SOL_SOCKET, SO_PEERCRED, &who, &length);
    if (!client || too_many(socket, who.pid)) {
        note("%d is refused: too many connections", (int)who.pid);
        free(client);
        close(socket);
        return NULL;
    }
    client->pid = who.pid;
    client->socket = socket;
    client->pin_fd = client->offered_notice_fd = client->offered_pin_fd = -1;
    client->next = store.clients;
    store.clients = client;
    DDX_PASS(STORE_CLIENT);
    return client;
}

void client_send(struct client *client, const struct ddx_message *message, const struct ddx_layout *layout,
                 const int *fds, unsigned count) {
    if (client->gone)
        return;
    if (message->operation == DDX_EPOCH)
        ddx_queue_drop_epoch(&client->queue);
    int result = ddx_queue_send(&client->queue, client->socket, message, layout, fds, count);
    if (client->queue.count > QUEUED_MAX)
        note("%d asks and does not listen; closing its connection", (int)client->pid);
    else if (result && result != -EPIPE)
        note("%d does not listen, and what it is to hear cannot be kept (%s); closing its connection",
             (int)client->pid, strerror(-result));
    else if (client->queue.files && client_holds_too_much(client)) {
        note("%d does not listen, and others need descriptors, too; closing a connection", (int)client->pid);
        client->gone = true;
    }
    client->gone |= result || client->queue.count > QUEUED_MAX;
}

void client_go_on(struct client *client) {
    if (ddx_queue_go_on(&client->queue, client->socket))
        client->gone = true;
}

void client_reply(struct client *client, uint32_t operation, int status) {
    struct ddx_message message = {.operation = operation, .status = status};

    client_send(client, &message, NULL, NULL, 0);
}

/* After a restart, newcomers wait until living holders have reported, or they would find items missing. */
static bool too_early(struct client *client) {
    uint32_t operation = 0;

    if (!store.restarted || store.open || client->item)
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
        int result = ddx_receive(client->socket, &packet);
        if (result == 0)
            return;
        if (result < 0) {
            if (result == -EPROTO)
                note("%d sent nonsense; closing its connection", (int)client->pid);
            client->gone = true;
            return;
        }
        store.current = client;
        request_handle(client, &packet);
        store.current = NULL;
        ddx_packet_close(&packet);
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
    for (struct client *client = store.clients; client; client = client->next) {
        struct pollfd look = {.fd = client->socket};

        if (client != store.current && (client->gone || (poll(&look, 1, 0) > 0 && look.revents & (POLLHUP | POLLERR))))
            detach(client);
    }
}

void clients_sweep(void) {
    struct client **link = &store.clients;

    while (*link) {
        struct client *client = *link;

        if (client->gone) {
            *link = client->next;
            detach(client);
            offer_abandon(client);
            ddx_queue_clear(&client->queue);
            close(client->socket);
            free(client);
            link = &store.clients; /* forgetting one may have found out that another is gone, too */
        } else
            link = &client->next;
    }
}
