/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include "../lib/fault.h"
#include "adopt.h"
#include "budget.h"
#include "claim.h"
#include "files.h"
#include "holder.h"
#include "items.h"
#include "kept.h"
#include "link.h"
#include "news.h"
#include "note.h"
#include "process.h"
#include "readers.h"
#include "request.h"
#include "session.h"

#define MESSAGES_AT_ONCE 64 /* then the others get their turn */

/*
 * One process gets a quarter of our descriptors at most, and all connections together three quarters: the rest is for
 * memory files. Descriptors are given out from below, so the newest one tells how many there are.
 */
static bool too_many(const struct process *process, int socket) {
    struct rlimit limit;

    if (getrlimit(RLIMIT_NOFILE, &limit))
        return false;
    return process->clients > limit.rlim_cur / 4 || (rlim_t)socket >= limit.rlim_cur / 4 * 3;
}

static struct client *allocate(struct process *process) {
    kept_charge(&process->account, KEPT_SHARE);
    struct client *client = kept_allocate(sizeof *client);
    kept_charge(NULL, 0);
    return client;
}

struct client *client_add(struct store *store, int socket) {
    struct ucred who = {0};
    socklen_t length = sizeof who;

    getsockopt(socket, SOL_SOCKET, SO_PEERCRED, &who, &length);
    struct process *process = process_join(store, who.pid);
    bool many = process && too_many(process, socket);
    struct client *client = process && !many ? allocate(process) : NULL;
    if (!client) {
        note("%d is refused: %s", (int)who.pid, many ? "too many connections" : "no memory for one connection more");
        if (process)
            process_leave(process);
        close(socket);
        return NULL;
    }
    client->store = store;
    client->process = process;
    client->pid = who.pid;
    client->socket = socket;
    client->pin_fd = client->offered_notice_fd = client->offered_pin_fd = -1;
    client->next = store->clients;
    store->clients = client;
    DDX_PASS(STORE_CLIENT);
    return client;
}

/* After a restart, newcomers wait until living holders have reported, or they would find items missing. */
static bool too_early(struct client *client) {
    uint32_t operation = 0;

    if (!client->store->settings->restarted || client->store->open || client->item)
        return false;
    ssize_t got = recv(client->socket, &operation, sizeof operation, MSG_PEEK | MSG_DONTWAIT);
    return got > 0 && (operation == DDX_OPEN || operation == DDX_LIST);
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

/*
 * Take back what those hold who hung up but whose last messages were not read yet: who asks for a thing after another
 * gave it back must get it.
 */
static void reap(const struct client *asking) {
    for (struct client *client = asking->store->clients; client; client = client->next) {
        struct pollfd look = {.fd = client->socket};

        if (client != asking && (client->gone || (poll(&look, 1, 0) > 0 && look.revents & (POLLHUP | POLLERR))))
            detach(client);
    }
}

/* Its process pays for what comes of it. */
static void handle(struct client *client, struct ddx_packet *packet) {
    struct process *process = client->process;

    budget_make_room(client->store, process);
    kept_charge(&process->account, KEPT_SHARE);
    request_handle(client, packet);
    kept_charge(NULL, 0);
    process_report(process);
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
            if (request_counts(&packet))
                reap(client);
            handle(client, &packet);
            client->handled = packet.message.number ? packet.message.number : client->handled;
            DDX_PASS(STORE_HANDLED);
            files_commit();
            holder_serving(-1);
        }
        ddx_packet_close(&packet);
        ddx_discard(client->socket);
        DDX_PASS(STORE_DISCARDED);
        /* Who complains is told first what comes of it. */
        clients_tell(client->store, packet.message.status ? NULL : client);
    }
}

void clients_sweep(struct store *store) {
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
            process_leave(client->process);
            kept_free(client);
            link = &store->clients; /* forgetting one may have found out that another is gone, too */
        } else
            link = &client->next;
    }
    processes_sweep(store);
}

/* Not before it is committed: what was said is true whoever dies. */
void clients_tell(struct store *store, struct client *last) {
    bool said = clients_go_on(store, last);
    readers_tell(store);
    if (!said)
        return;
    DDX_PASS(STORE_SAID);
    files_commit();
}
