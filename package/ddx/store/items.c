/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "items.h"

#include <errno.h>
#include <string.h>
#include <sys/mman.h>

#include "../lib/fault.h"
#include "checkpoint.h"
#include "epoch.h"
#include "files.h"

/* ---- Retired epochs ---- */

/*
 * Epochs that have ended. A client that is stopped, or has not read yet that the next epoch has begun, still maps the
 * old memory, so that memory counts until the kernel reports that no process has it.
 */

static bool is_in_use(int watch) {
    return ddx_memory_shared(watch) || ddx_memory_held(watch);
}

static bool is_known(const struct store *store, int watch) {
    for (const struct retired *retired = store->retired; retired; retired = retired->next)
        if (ddx_memory_same(retired->watch, watch))
            return true;
    return false;
}

void epoch_retire(struct item *item, struct epoch *epoch) {
    struct store *store = item->store;
    /* Charged to no client: the process that causes the change of epoch is not the one that still maps it. */
    struct checkpoint_payer client = checkpoint_charge(NULL, 0);
    struct retired *retired = epoch && epoch->control_fd >= 0 ? checkpoint_allocate(sizeof *retired) : NULL;

    checkpoint_charge(client.account, client.most);
    int watch = retired ? ddx_memory_watch(epoch->control_fd) : -1;

    if (watch >= 0) {
        uint64_t bytes = ddx_page_round(sizeof(struct ddx_control)) + epoch->slots * epoch->runs.file_bytes;

        *retired = (struct retired){store->retired, item, bytes, watch};
    }
    epoch_free(epoch); /* the store's own descriptors and mappings must not count */
    if (watch >= 0 && is_in_use(watch) && !is_known(store, watch)) {
        store->retired = retired;
        return;
    }
    if (watch >= 0)
        file_close(watch);
    checkpoint_free(retired);
}

uint64_t retired_bytes(const struct store *store, const struct item *item) {
    uint64_t sum = 0;

    for (const struct retired *retired = store->retired; retired; retired = retired->next)
        if (retired->item == item)
            sum += retired->bytes;
    return sum;
}

void retired_sweep(struct store *store) {
    struct retired **link = &store->retired;

    while (*link) {
        struct retired *retired = *link;

        if (is_in_use(retired->watch)) {
            link = &retired->next;
            continue;
        }
        *link = retired->next;
        file_close(retired->watch);
        checkpoint_free(retired);
    }
}

/* it is being dropped */
static void retired_forget(const struct item *item) {
    for (struct retired *retired = item->store->retired; retired; retired = retired->next)
        if (retired->item == item)
            retired->item = NULL;
}

/* ---- Items ---- */

struct item *item_find(const struct store *store, const char *name) {
    for (struct item *item = store->items; item; item = item->next)
        if (!strcmp(item->name, name))
            return item;
    return NULL;
}

struct item *item_add(struct store *store, const char *name, const char *type, const struct ddx_layout *layout) {
    struct item *item = checkpoint_allocate(sizeof *item), **link = &store->items;

    if (!item || (layout && !(item->layout = store_layout(layout)))) {
        checkpoint_free(item);
        return NULL;
    }
    item->store = store;
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

const struct ddx_layout *item_layout(const struct item *item) {
    return item->epoch ? item->epoch->layout : item->layout;
}

void item_begin_epoch(struct item *item, struct epoch *epoch) {
    struct epoch *former = item->epoch;

    item->epoch = epoch;
    item->epochs = epoch->number;
    epoch_retire(item, former);
    checkpoint_free(item->layout);
    item->layout = NULL;
}

bool item_is_awaited(const struct item *item) {
    return !*item->type;
}

int item_define(struct item *item, const char *type, const struct ddx_layout *layout) {
    checkpoint_free(item->layout);
    item->layout = store_layout(layout);
    if (!item->layout)
        return -errno;
    strcpy(item->type, type);
    DDX_PASS(STORE_ITEM);
    return 0;
}

void item_drop_if_unused(struct item *item) {
    struct item **link = &item->store->items;

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
    checkpoint_free(item->layout);
    checkpoint_free(item);
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
    return 0;
}

static uint64_t control_bytes(void) {
    return ddx_page_round(sizeof(struct ddx_control));
}

static uint64_t epoch_bytes(const struct epoch *epoch) {
    return epoch ? control_bytes() + epoch_slots_planned(epoch) * epoch->runs.file_bytes : 0;
}

uint64_t item_bytes(const struct item *item) {
    uint64_t pages = item->readers + (item->notice ? 1 : 0);

    return epoch_bytes(item->epoch) + epoch_bytes(item->pending) + pages * ddx_page_round(1);
}

uint64_t item_reserved(const struct item *item) {
    const struct epoch *epoch = item->pending ? item->pending : item->epoch;
    uint64_t next = epoch ? control_bytes() + ddx_page_round(1) + (2 + item->keep_total) * epoch->runs.file_bytes : 0;
    uint64_t now = item_bytes(item), then = now + next, ended = retired_bytes(item->store, item);

    /* While a new writer prepares its epoch, the pending files use the reservation for the next epoch; once they
     * replace the old ones, there must be room for a further epoch. */
    if (item->pending && item->epoch)
        then -= epoch_bytes(item->epoch);
    /* An ended epoch that a client still maps uses the reservation for the next one. */
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
    for (const struct client *c = NULL; (c = item_next_reader(item, c));) {
        uint64_t missed = (uint64_t)atomic_load(&c->pin->missed_high) << 32 | atomic_load(&c->pin->missed_low);

        if (missed > m->missed)
            m->missed = missed;
    }
}

struct client *item_next_reader(const struct item *item, const struct client *former) {
    struct client *client = former ? former->next : item->store->clients;

    while (client && (client->item != item || !client->id || client->gone))
        client = client->next;
    return client;
}
