/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include "../lib/fault.h"
#include "adopt.h"
#include "budget.h"
#include "checkpoint.h"
#include "claim.h"
#include "descriptors.h"
#include "files.h"
#include "holder.h"
#include "items.h"
#include "log.h"
#include "notify.h"
#include "process.h"
#include "readers.h"
#include "request.h"
#include "send.h"
#include "session.h"

#define FULL 100000000      /* ns without a look at the listening socket when there is no descriptor for a connection */

static uint32_t turn; /* of this worker */

/* A quarter of our descriptors. */
static int quarter(void) {
    struct rlimit limit;

    return getrlimit(RLIMIT_NOFILE, &limit) || limit.rlim_cur > INT_MAX ? INT_MAX / 4 : (int)(limit.rlim_cur / 4);
}

/* One process gets a quarter of our descriptors at most. */
static bool too_many(const struct process *process) {
    return process->clients > (unsigned)quarter();
}

/*
 * All connections together get three quarters: the rest is for memory files. Descriptors are given out from below, so
 * the newest one tells how many there are, and it takes the place of a file dropped for it. False: no place.
 */
static bool find_place(struct store *store, int *socket) {
    while (*socket >= quarter() * 3) {
        int lower = descriptors_below(store, quarter() * 3) ? fcntl(*socket, F_DUPFD_CLOEXEC, 0) : -1;

        if (lower < 0)
            return false;
        close(*socket);
        *socket = lower;
    }
    return true;
}

static struct client *allocate(struct process *process) {
    checkpoint_charge(&process->account, CHECKPOINT_SHARE);
    struct client *client = checkpoint_allocate(sizeof *client);
    checkpoint_charge(NULL, 0);
    return client;
}

struct client *client_add(struct store *store, int socket) {
    struct ucred peer = {0};
    socklen_t length = sizeof peer;

    getsockopt(socket, SOL_SOCKET, SO_PEERCRED, &peer, &length);
    struct process *process = process_join(store, peer.pid);
    bool has_place = process && !too_many(process) && find_place(store, &socket);
    struct client *client = has_place ? allocate(process) : NULL;
    if (!client) {
        log_line("%d is refused: %s", (int)peer.pid,
             process && !has_place ? "too many connections" : "no memory for one connection more");
        if (process)
            process_leave(process);
        close(socket);
        return NULL;
    }
    client->store = store;
    client->process = process;
    client->pid = peer.pid;
    client->socket = socket;
    client->pin_fd = client->offered_notice_fd = client->offered_pin_fd = -1;
    client->next = store->clients;
    store->clients = client;
    DDX_PASS(STORE_CLIENT);
    return client;
}

/* For the next look at the listening socket; a client that leaves brings it forward. */
static int64_t full_until;

void client_accept(struct store *store) {
    static bool said;
    int fd;

    clients_sweep(store); /* what those had open that are gone may be dropped */
    do
        fd = accept4(store->settings->listener, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);
    while (fd < 0 && errno == EMFILE && descriptors_below(store, INT_MAX));
    if (fd >= 0) {
        said = false;
        client_add(store, fd);
        return;
    }
    if (errno == EAGAIN || errno == EINTR || errno == ECONNABORTED)
        return; /* it did not wait */
    if (!said)
        log_line("programs that come have to wait: %s", strerror(errno));
    said = true;
    full_until = ddx_time_now() + FULL;
}

bool clients_must_wait(void) {
    return full_until && ddx_time_now() < full_until;
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

/* What poll() knows of all clients, in the order of their list; NULL: no memory. */
static const struct pollfd *look(const struct store *store) {
    static struct pollfd *list;
    static size_t room;
    size_t count = 0;

    for (const struct client *client = store->clients; client; client = client->next) {
        if (count == room) {
            struct pollfd *more = realloc(list, (2 * room + 64) * sizeof *list);

            if (!more)
                return NULL;
            list = more;
            room = 2 * room + 64;
        }
        list[count++] = (struct pollfd){.fd = client->socket};
    }
    if (poll(list, count, 0) < 0)
        return NULL;
    return list;
}

/*
 * Take back the holdings of clients that hung up and whose last messages were not read yet: a client that asks for
 * something after another client gave it back must get it.
 */
static void reap(const struct client *asking) {
    const struct pollfd *found = look(asking->store);

    for (struct client *client = asking->store->clients; client && found; client = client->next, found++)
        if (client != asking && (client->gone || found->revents & (POLLHUP | POLLERR)))
            detach(client);
}

/* Its process pays for what comes of it. False: it stays, for the next turn. */
static bool handle(struct client *client, struct ddx_packet *packet) {
    struct process *process = client->process;

    budget_make_room(client->store, process);
    checkpoint_charge(&process->account, CHECKPOINT_SHARE);
    bool waits = request_must_wait(client, packet);
    if (!waits)
        request_handle(client, packet);
    checkpoint_charge(NULL, 0);
    process_report(process);
    return !waits;
}

/* A worker may have done this, and died before it took it off. */
static bool is_handled(struct client *client, struct ddx_packet *packet) {
    uint64_t number = packet->message.number;

    if (number && number <= client->handled)
        return true;
    holder_serving(client->socket);
    if (request_counts(packet))
        reap(client);
    bool done = handle(client, packet);
    if (done) {
        client->handled = number ? number : client->handled;
        DDX_PASS(STORE_HANDLED);
    }
    files_commit();
    holder_serving(-1);
    return done;
}

void client_receive(struct client *client, unsigned most) {
    static struct ddx_packet packet;

    for (unsigned i = 0; i < most && !client->gone; i++) {
        client->early = too_early(client);
        if (client->early)
            return;
        int result = ddx_peek(client->socket, &packet);
        if (result == 0)
            return;
        if (result < 0) {
            if (result == -EPROTO)
                log_line("%d sent nonsense; closing its connection", (int)client->pid);
            client->gone = true;
            return;
        }
        holder_beat(); /* a turn with many messages is no sign of a worker that hangs */
        process_heard(client->process, turn);
        bool done = is_handled(client, &packet);
        ddx_packet_close(&packet);
        if (!done)
            return;
        ddx_discard(client->socket);
        DDX_PASS(STORE_DISCARDED);
        /* The complaining client gets its reply first. */
        clients_tell(client->store, packet.message.status ? NULL : client);
    }
}

static void hear(struct client *client, short found) {
    if (found & POLLOUT && client->listing && !client->gone) {
        process_heard(client->process, turn);
        list_continue(client);
    }
    if (client->early && found & (POLLHUP | POLLERR))
        client->gone = true; /* what it asked for it wants no more */
    else if (found & ~POLLOUT)
        client_receive(client, process_share(client->process, turn));
}

/* Clients `from` to `to` of the list. The first one whose process had no share left; `to`: each was heard. */
static size_t hear_some(struct store *store, const struct pollfd *found, size_t from, size_t to) {
    size_t i = 0, first = to;

    for (struct client *client = store->clients; client && i < to; client = client->next, i++) {
        if (i < from || !found[i].revents)
            continue;
        if (process_share(client->process, turn))
            hear(client, found[i].revents);
        else if (first == to)
            first = i;
    }
    return first;
}

void clients_hear(struct store *store, const struct pollfd *found) {
    static size_t first; /* of those whose turn it is before the others */
    size_t count = 0;

    for (const struct client *client = store->clients; client; client = client->next)
        count++;
    turn++;
    size_t begun = first < count ? first : 0;
    size_t late = hear_some(store, found, begun, count), early = hear_some(store, found, 0, begun);
    first = late < count ? late : early;
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
            checkpoint_free(client);
            holder_beat();
            full_until = 0;
            link = &store->clients; /* forgetting one may have found out that another is gone, too */
        } else
            link = &client->next;
    }
    processes_sweep(store);
}

/* Not before the commit: a reply must hold even if any process dies. */
void clients_tell(struct store *store, struct client *last) {
    bool said = clients_go_on(store, last);
    readers_tell(store);
    if (!said)
        return;
    DDX_PASS(STORE_SAID);
    files_commit();
}
