/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <string.h>
#include <sys/mman.h>

#include "../lib/fault.h"
#include "budget.h"
#include "epoch.h"
#include "files.h"
#include "items.h"
#include "log.h"
#include "send.h"
#include "terms.h"

/* ns */
#define STOPPED_NS 100000000   /* without an answer, after which a writer seems to be stopped */
#define PATIENCE_NS 4000000000 /* that a reader waits at most; the reader itself gives up after five seconds */
#define AGAIN_NS 50000000      /* between announcements of a reader whose pins the writer could not map */

/* NULL: the item was never written, and the size of its frames is unknown. */
static struct epoch *newest_epoch(const struct item *item) {
    return item->pending ? item->pending : item->epoch;
}

/* Number of slots to add so that `keep` more frames can be kept; -EBUSY: no room for them. */
static int slots_to_add(struct item *item, unsigned keep, unsigned pages) {
    const struct epoch *epoch = newest_epoch(item);
    unsigned wanted = 2 + item->keep_total + keep, more = 0;
    uint64_t cost = pages * ddx_page_round(1);

    if (wanted > DDX_SLOTS_MAX || item->readers + pages > DDX_READERS_MAX)
        return -EBUSY;
    if (epoch) {
        unsigned planned = epoch_slots_planned(epoch);

        more = item->writer && wanted > planned ? wanted - planned : 0;
        cost += (more + keep) * epoch->runs.file_bytes;
    }
    return budget_allows(item, item_reserved(item) + cost) ? (int)more : -EBUSY;
}

int reader_add_slots(struct item *item, unsigned keep, unsigned pages) {
    struct epoch *epoch = newest_epoch(item);
    int more = slots_to_add(item, keep, pages);

    if (more < 0 || !epoch)
        return more;
    bool enough = descriptors_for_item(item, (unsigned)more + pages);
    if (!more)
        return 0;
    if (!enough || epoch_add_slots(epoch, item->name, (unsigned)more))
        return -EBUSY;
    DDX_PASS(STORE_ROOM);
    notify_slots(item, epoch, item->writer);
    return 0;
}

int reader_register(struct client *client, int pin_fd, unsigned keep) {
    struct item *item = client->item;
    const void *pin = ddx_memory_map(pin_fd, sizeof(struct ddx_pin_page), false);

    if (!pin) {
        file_close(pin_fd);
        return -ENOMEM;
    }
    client->pin_fd = pin_fd;
    client->pin = pin;
    client->id = ++client->store->next_reader;
    client->keep = keep;
    client->counted = client->admitted = false;
    item->keep_total += keep;
    item->readers++;
    if (item->writer)
        notify_reader(item, client);
    DDX_PASS(STORE_REGISTERED);
    return 0;
}

static int may_attach(const struct client *client, unsigned keep) {
    const struct item *item = client->item;

    if (keep < 1 || keep > DDX_READERS_MAX)
        return -EINVAL;
    /* The writer lives, but is not connected (it has not reported since this store started, or has disconnected), so it
     * would not check the new pins. Also while another writer prepares to replace it: until then it may still write. */
    if (item->epoch && (!item->writer || item->pending) && ddx_memory_held(item->epoch->control_fd))
        return -EAGAIN;
    return 0;
}

bool reader_must_wait(struct client *client, unsigned keep) {
    struct item *item = client->item;
    struct epoch *epoch = item && item->writer && !client->asked ? newest_epoch(item) : NULL;

    if (!epoch || may_attach(client, keep))
        return false;
    int more = slots_to_add(item, keep, client->id ? 0 : 1);
    unsigned now = more > 0 ? epoch_slots_a_turn(epoch, (unsigned)more) : 0;
    if (more <= (int)now)
        return false;
    /* Descriptors for all slots: a request that must be refused in the end shall drop no items and make no files. */
    if (!descriptors_for_item(item, (unsigned)more + !client->id) || epoch_add_slots(epoch, item->name, now))
        return false; /* reader_attach() will refuse it */
    notify_slots(item, epoch, item->writer);
    return true;
}

static int attach(struct client *client, unsigned keep) {
    struct item *item = client->item;
    int result = may_attach(client, keep);

    if (!result)
        result = reader_add_slots(item, keep, client->id ? 0 : 1);
    if (result)
        return result;
    if (client->id) {
        client->keep += keep;
        item->keep_total += keep;
        if (item->writer)
            notify_reader(item, client);
        return 0;
    }
    int fd = ddx_memory_create(memfd_name_of(item->name, "pin"), ddx_page_round(1), NULL);
    return fd < 0 ? -EBUSY : reader_register(client, fd, keep);
}

/* Answer the reader's ATTACH. */
static void reply(struct client *client, int status) {
    struct ddx_message message = {.operation = DDX_ATTACHED, .status = status, .sequence = client->asked_after};
    bool before = client->admitted;

    strcpy(message.name, client->item->name);
    client->asked = 0;
    if (status || before) {
        client_send(client, &message, NULL, NULL, 0);
        return;
    }
    client->admitted = true;
    if (client->item->epoch)
        notify_epoch(client->item, client);
    client_send(client, &message, NULL, &client->pin_fd, 1);
    readers_count(client->item); /* not yet counted if the writer lacks slots: see writer_ready() */
}

void reader_attach(struct client *client, unsigned keep) {
    struct item *item = client->item;
    struct ddx_ring_frame frame;

    if (client->asked) { /* one request at a time */
        client->gone = true;
        return;
    }
    /* Before the reader is announced to the writer: all later frames must count as not yet seen. */
    client->asked_after = item->epoch && ddx_ring_peek(item->epoch->control, &frame) ? frame.sequence : item->sequence;
    int result = attach(client, keep);
    client->asked = keep;
    client->asked_at = ddx_time_now();
    if (result || !item->writer)
        reply(client, result);
}

/* Undo the reader's request. */
static void withdraw(struct client *client, int status) {
    struct item *item = client->item;
    unsigned asked = client->asked;

    reply(client, status);
    if (!client->admitted) {
        reader_left(client);
        return;
    }
    client->keep -= asked;
    item->keep_total -= asked;
    if (item->writer)
        notify_reader(item, client);
}

static void admit(struct client *client) {
    if (client->asked) {
        reply(client, 0);
        return;
    }
    client->admitted = true; /* it returned with an offer */
    if (client->item->epoch)
        notify_epoch(client->item, client);
    readers_count(client->item);
}

void reader_taken(struct client *client, int status) {
    client->unseen = status && client->admitted && !client->asked;
    if (!status && (client->asked || !client->admitted))
        admit(client);
    else if (status && client->asked) {
        log_line("%s: its writer cannot take another reader, %d: %s", client->item->name, (int)client->pid,
                 strerror(-status));
        withdraw(client, -EBUSY);
    } else if (status && !client->admitted)
        client->gone = true; /* it will offer again, and there may be room then */
}

/* Whether the reader's announcement is in its writer's socket: the writer will read it before it overwrites a frame. */
static bool is_noticed(const struct client *client) {
    const struct item *item = client->item;

    return item->writer && !item->pending && item->notice &&
           (int32_t)(atomic_load(&item->notice->version) - client->version) >= 0;
}

bool readers_wait(struct store *store) {
    int64_t now = ddx_time_now();
    bool any = false;

    for (struct client *c = store->clients; c; c = c->next) {
        if (c->gone || !(c->asked || c->unseen))
            continue;
        if (c->unseen && now - c->told_at > AGAIN_NS && c->item->writer) {
            c->told_at = now;
            notify_reader(c->item, c);
        } else if (c->asked && now - c->asked_at > PATIENCE_NS)
            withdraw(c, -EBUSY);
        else if (c->asked && now - c->asked_at > STOPPED_NS && is_noticed(c))
            admit(c);
        any = true;
    }
    return any;
}

void readers_without_writer(struct item *item) {
    bool lives = item->epoch && ddx_memory_held(item->epoch->control_fd);

    for (struct client *c = NULL; (c = item_next_reader(item, c));) {
        if (!lives && (c->asked || !c->admitted))
            reader_taken(c, 0);
        else if (lives && c->asked)
            withdraw(c, -EAGAIN);
    }
}

void reader_left(struct client *client) {
    struct item *item = client->item;
    struct ddx_message message = {
        .operation = DDX_READER_GONE, .index = client->id, .size = ddx_memory_number(client->pin_fd)};

    if (!client->id)
        return;
    munmap((void *)(uintptr_t)client->pin, sizeof *client->pin);
    file_close(client->pin_fd);
    client->id = 0;
    client->admitted = client->unseen = false;
    client->asked = 0;
    item->readers--;
    item->keep_total -= client->keep;
    DDX_PASS(STORE_READER_LEFT);
    if (item->writer && !item->writer->gone)
        client_send(item->writer, &message, NULL, NULL, 0);
    readers_count(item);
}
