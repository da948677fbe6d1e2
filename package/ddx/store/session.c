/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "session.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include "../lib/fault.h"
#include "terms.h"
#include "budget.h"
#include "checkpoint.h"
#include "epoch.h"
#include "files.h"
#include "holder.h"
#include "items.h"
#include "log.h"
#include "send.h"

/* Whether the message must wait for the next turn: see reader_must_wait(). */
bool request_must_wait(struct client *client, const struct ddx_packet *packet);
void request_handle(struct client *client, struct ddx_packet *packet);
/* Whether the answer depends on other clients: then dead clients must be removed first. */
bool request_counts(const struct ddx_packet *packet);
/* Send the next part of the list; the rest follows when the client has read that part. */
void list_continue(struct client *client);

/* ---- Requests ---- */

/* Handling of one message of a client. */

#define LISTED_AT_ONCE 64
#define ERRNO_MAX 4095 /* of Linux */

static void open_item(struct client *client, struct ddx_packet *packet) {
    const struct ddx_message *m = &packet->message;
    const struct ddx_layout *layout = ddx_packet_layout(packet);
    struct ddx_message reply = {.operation = DDX_OPENED};
    struct item *item = item_find(client->store, m->name);
    bool creates = m->flags & DDX_FLAG_CREATE, awaits = m->flags & DDX_FLAG_AWAIT;

    if (client->item || !ddx_item_name_ok(m->name) || (*m->type && !ddx_type_name_ok(m->type)))
        reply.status = -EINVAL;
    else if ((!item || item_is_awaited(item)) && !creates && !awaits)
        reply.status = -ENOENT;
    else if ((!item || item_is_awaited(item)) && creates && (!layout || !*m->type))
        reply.status = -EINVAL;
    else if (!item && !(item = item_add(client->store, m->name, creates ? m->type : "", creates ? layout : NULL)))
        reply.status = -errno;
    else if (item_is_awaited(item) && creates)
        reply.status = item_define(item, m->type, layout);
    if (reply.status) {
        client_send(client, &reply, NULL, NULL, 0);
        return;
    }
    /* Another type than before: allowed to a future writer, if no program has the item open. */
    if (m->flags & DDX_FLAG_WRITER && !item->handles && layout &&
        (strcmp(item->type, m->type) || ddx_layout_may_become(item_layout(item), layout))) {
        struct item *former = item;

        if (!(item = item_add(client->store, m->name, m->type, layout))) {
            client_reply(client, DDX_OPENED, -errno);
            return;
        }
        epoch_free(former->epoch);
        former->epoch = NULL;
        item_drop_if_unused(former);
    }
    client->item = item;
    item->handles++;
    DDX_PASS(STORE_OPENED);
    strcpy(reply.name, item->name);
    strcpy(reply.type, item->type);
    client_send(client, &reply, item_layout(item), NULL, 0);
}

void list_continue(struct client *client) {
    struct store *store = client->store;
    struct ddx_message m;
    unsigned listed = 0;

    if (client->queue.count)
        return; /* earlier messages first */
    for (struct item *item = store->items; item; item = item->next) {
        if (strcmp(item->name, client->listed) <= 0 || item_is_awaited(item))
            continue;
        if (listed++ == LISTED_AT_ONCE)
            return;
        item_describe(item, &m);
        client_send(client, &m, NULL, NULL, 0);
        strcpy(client->listed, item->name);
    }
    memset(&m, 0, sizeof m);
    m.operation = DDX_LISTED;
    m.size = store->settings->budget;
    m.bytes = budget_used(store);
    m.reserved = budget_reserved(store);
    m.pid = (int32_t)getppid(); /* the holder: the process to stop */
    m.index = holder_restarts();
    for (const struct client *c = store->clients; c; c = c->next)
        m.readers += c->item != NULL;
    client_send(client, &m, NULL, NULL, 0);
    client->listing = false;
}

bool request_counts(const struct ddx_packet *packet) {
    switch (packet->message.operation) {
    case DDX_CLAIM:
    case DDX_ATTACH:
    case DDX_INFO:
    case DDX_LIST:
    case DDX_OFFER_END: return true;
    default: return false;
    }
}

bool request_must_wait(struct client *client, const struct ddx_packet *packet) {
    return packet->message.operation == DDX_ATTACH && reader_must_wait(client, packet->message.frames);
}

void request_handle(struct client *client, struct ddx_packet *packet) {
    const struct ddx_message *m = &packet->message;

    if (client->pid == 0)
        client->pid = m->pid; /* the kernel cannot report a pid of another name space: use the client's own word */
    if (m->status > 0 || m->status < -ERRNO_MAX) { /* not an errno, but it is logged as one */
        client->gone = true;
        return;
    }
    if (!client->item && m->operation != DDX_OPEN && m->operation != DDX_LIST && m->operation != DDX_OFFER) {
        client->gone = true;
        return;
    }
    switch (m->operation) {
    case DDX_OPEN: open_item(client, packet); break;
    case DDX_CLAIM: writer_claim(client, ddx_packet_layout(packet)); break;
    case DDX_READY: writer_ready(client, m); break;
    case DDX_TAKEN: writer_taken(client, m); break;
    case DDX_ATTACH: reader_attach(client, m->frames); break;
    case DDX_INFO: {
        struct ddx_message reply;

        item_describe(client->item, &reply);
        client_send(client, &reply, NULL, NULL, 0);
        break;
    }
    case DDX_LIST:
        client->listing = true;
        client->listed[0] = 0;
        list_continue(client);
        break;
    case DDX_OFFER:
    case DDX_OFFER_SLOT:
    case DDX_OFFER_PIN:
    case DDX_OFFER_END: offer_message(client, packet); break;
    default: client->gone = true; break;
    }
}

/* ---- Sessions ---- */

#define FULL_NS 100000000 /* without polling the listening socket when there is no descriptor for a connection */

static uint32_t turn; /* of this worker */

/* A quarter of the store's descriptors. */
static int quarter(void) {
    struct rlimit limit;

    return getrlimit(RLIMIT_NOFILE, &limit) || limit.rlim_cur > INT_MAX ? INT_MAX / 4 : (int)(limit.rlim_cur / 4);
}

/* One process gets a quarter of the descriptors at most. */
static bool has_too_many(const struct process *process) {
    return process->clients > (unsigned)quarter();
}

/*
 * All connections together get three quarters: the rest is for memory files. The kernel assigns the lowest free
 * number, so a high one shows that the share is used up; then the connection replaces the file of a dropped item.
 * False: no place.
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
    bool has_place = process && !has_too_many(process) && find_place(store, &socket);
    struct client *client = has_place ? allocate(process) : NULL;
    if (!client) {
        log_line("%d is refused: %s", (int)peer.pid,
                 process && !has_place ? "too many connections" : "no memory for another connection");
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

/* The listening socket is not polled before this time, unless a client leaves. */
static int64_t full_until;

void client_accept(struct store *store) {
    static bool said;
    int fd;

    clients_sweep(store); /* items that disconnected clients had open may then be dropped */
    do
        fd = accept4(store->settings->listener, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);
    while (fd < 0 && errno == EMFILE && descriptors_below(store, INT_MAX));
    if (fd >= 0) {
        said = false;
        client_add(store, fd);
        return;
    }
    if (errno == EAGAIN || errno == EINTR || errno == ECONNABORTED)
        return; /* the connection was aborted */
    if (!said)
        log_line("new connections must wait: %s", strerror(errno));
    said = true;
    full_until = ddx_time_now() + FULL_NS;
}

bool clients_must_wait(void) {
    return full_until && ddx_time_now() < full_until;
}

/* After a restart, new clients wait until living holders have reported; otherwise items would be missing. */
static bool is_too_early(struct client *client) {
    uint32_t operation = 0;

    if (!client->store->settings->restarted || client->store->open || client->item)
        return false;
    ssize_t got = recv(client->socket, &operation, sizeof operation, MSG_PEEK | MSG_DONTWAIT);
    return got > 0 && (operation == DDX_OPEN || operation == DDX_LIST);
}

/* Release the client's holdings. */
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

/* Poll all clients, in the order of their list; NULL: no memory. */
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
 * Release the holdings of clients that have disconnected but whose last messages are unread: a client that asks for
 * something that another client has just given up must get it.
 */
static void reap(const struct client *asking) {
    const struct pollfd *found = look(asking->store);

    for (struct client *client = asking->store->clients; client && found; client = client->next, found++)
        if (client != asking && (client->gone || found->revents & (POLLHUP | POLLERR)))
            detach(client);
}

/* Memory that the request causes is charged to the client's process. False: the request waits for the next turn. */
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

/* A former worker may have handled this message, and died before it removed the message from the socket. */
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
        client->early = is_too_early(client);
        if (client->early)
            return;
        int result = ddx_peek(client->socket, &packet);
        if (result == 0)
            return;
        if (result < 0) {
            if (result == -EPROTO)
                log_line("%d sent an invalid message; closing its connection", (int)client->pid);
            client->gone = true;
            return;
        }
        holder_beat(); /* a turn with many messages may take long */
        process_heard(client->process, turn);
        bool done = is_handled(client, &packet);
        ddx_packet_close(&packet);
        if (!done)
            return;
        ddx_discard(client->socket);
        DDX_PASS(STORE_DISCARDED);
        /* Replies go to this client after all others, except when it reports an error. */
        clients_tell(client->store, packet.message.status ? NULL : client);
    }
}

static void hear(struct client *client, short found) {
    if (found & POLLOUT && client->listing && !client->gone) {
        process_heard(client->process, turn);
        list_continue(client);
    }
    if (client->early && found & (POLLHUP | POLLERR))
        client->gone = true; /* its waiting request is obsolete */
    else if (found & ~POLLOUT)
        client_receive(client, process_share(client->process, turn));
}

/* Hear clients `from` to `to` of the list. Returns the first one whose process had no share left, or `to`. */
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
    static size_t first; /* client to begin with */
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
            shutdown(client->socket, SHUT_RDWR); /* else the next worker might take it for a new connection */
            offer_abandon(client);
            ddx_queue_clear(&client->queue);
            file_close(client->socket);
            process_leave(client->process);
            checkpoint_free(client);
            holder_beat();
            full_until = 0;
            link = &store->clients; /* detaching one may have marked others as gone */
        } else
            link = &client->next;
    }
    processes_sweep(store);
}

/* Only after the commit: a reply must hold even if the worker dies. */
void clients_tell(struct store *store, struct client *last) {
    bool said = clients_go_on(store, last);
    readers_tell(store);
    if (!said)
        return;
    DDX_PASS(STORE_SAID);
    files_commit();
}
