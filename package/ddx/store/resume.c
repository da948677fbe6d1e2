/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Takeover of the state by the next worker: each action is committed before its messages are sent. */
#include <stdlib.h>
#include <string.h>

#include "files.h"
#include "holder.h"
#include "checkpoint.h"
#include "log.h"
#include "session.h"

static int use(int fd) {
    int result = file_use(fd);

    return result ? result : fd;
}

void store_memory(void) {
    static const struct ddx_queue_memory checkpoint_memory = {checkpoint_allocate, checkpoint_free, use, file_unuse};

    ddx_queue_memory = &checkpoint_memory;
}

struct store *store_begin(const struct settings *settings) {
    struct store *new = checkpoint_allocate(sizeof *new);

    if (!new)
        return NULL;
    new->settings = settings;
    new->next_reader = 1;
    files_use_table(&new->files);
    checkpoint_commit();
    return new;
}

static bool *known; /* by descriptor */
static unsigned known_count;

static void know(int fd) {
    if (fd < 0)
        return;
    if ((unsigned)fd >= known_count) {
        unsigned count = ((unsigned)fd + 1) * 2;
        bool *more = realloc(known, count * sizeof *more);

        if (!more)
            abort(); /* the next worker tries again */
        memset(more + known_count, 0, (count - known_count) * sizeof *more);
        known = more;
        known_count = count;
    }
    known[fd] = true;
}

static bool is_known(int fd) {
    return (unsigned)fd < known_count && known[fd];
}

static void found(void *store, int socket) {
    client_add(store, socket);
}

static void *map(int fd, size_t bytes, bool writable) {
    void *address = ddx_memory_map(fd, bytes, writable);

    if (!address)
        abort();
    return address;
}

/* The control page is sealed by now, so it is mapped read-only; the store's former writes remain in it. */
static void take_over_epoch(struct epoch *epoch) {
    if (!epoch)
        return;
    know(epoch->control_fd);
    know(epoch->readers_fd);
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        know(epoch->slot_fd[i]);
    if (epoch->control)
        epoch->control = map(epoch->control_fd, sizeof *epoch->control, false);
}

static void take_over_item(struct item *item) {
    know(item->notice_fd);
    if (item->notice)
        item->notice = map(item->notice_fd, sizeof *item->notice, true);
    take_over_epoch(item->epoch);
    take_over_epoch(item->pending);
}

static void take_over_client(struct client *client) {
    know(client->socket);
    know(client->offered_notice_fd);
    know(client->offered_pin_fd);
    take_over_epoch(client->offered);
    if (client->id) {
        know(client->pin_fd);
        client->pin = map(client->pin_fd, sizeof *client->pin, false);
    }
    if (client->socket == holder_banned()) {
        log_line("requests of %d have killed three workers; closing its connection", (int)client->pid);
        client->gone = true;
    }
}

struct store *store_take_over(void) {
    struct store *store = checkpoint_root();

    files_use_table(&store->files);
    for (struct item *item = store->items; item; item = item->next)
        take_over_item(item);
    for (struct client *client = store->clients; client; client = client->next)
        take_over_client(client);
    for (const struct retired *retired = store->retired; retired; retired = retired->next)
        know(retired->watch);
    files_sweep(is_known, found, store);
    clients_sweep(store);
    files_commit();
    clients_tell(store, NULL);
    return store;
}
