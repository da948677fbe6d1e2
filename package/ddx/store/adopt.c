/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <string.h>

#include "../lib/fault.h"
#include "terms.h"
#include "budget.h"
#include "epoch.h"
#include "files.h"
#include "items.h"
#include "log.h"
#include "send.h"

#define OFFERED 16 /* descriptors to free when an offer arrived without all of its files: the client offers again */
#define NOT_OURS "no store made these files, or they belong to another item"
#define NO_MEMORY "no memory"
#define NO_DESCRIPTOR "no descriptor is left"
#define NO_ROOM "the memory budget is used up; give the store more with -m"

void offer_abandon(struct client *client) {
    epoch_free(client->offered);
    client->offered = NULL;
    if (client->offered_notice_fd >= 0)
        file_close(client->offered_notice_fd);
    if (client->offered_pin_fd >= 0)
        file_close(client->offered_pin_fd);
    client->offered_notice_fd = client->offered_pin_fd = -1;
}

/*
 * Disconnect the client, which then offers again: there may be room next time. If the offer were only dropped, the
 * client would wait for messages in vain. Logged once for a client that keeps trying.
 */
static void refuse(struct client *client, const char *why) {
    static int32_t last;

    if (client->pid != last)
        log_line("%s: the offer of %d is refused: %s", client->item->name, (int)client->pid, why);
    last = client->pid;
    client->gone = true;
}

static void take_control(struct client *client, struct ddx_packet *packet, const struct ddx_layout *layout) {
    struct epoch *epoch = epoch_new(layout, packet->message.epoch);

    if (!epoch) {
        refuse(client, NO_MEMORY);
        return;
    }
    client->offered = epoch;
    epoch->control_fd = ddx_packet_take(packet, 0);
    if (memfd_name_is(epoch->control_fd, memfd_name_of_slot(client->item->name, epoch, DDX_NO_SLOT)) &&
        ddx_memory_sound(epoch->control_fd, ddx_page_round(sizeof(struct ddx_control)), true))
        epoch->control = ddx_memory_map(epoch->control_fd, sizeof(struct ddx_control), false);
    epoch->control_ready = epoch->control && epoch->control->magic == DDX_CONTROL_MAGIC &&
                           epoch->control->version == DDX_LAYOUT_VERSION && epoch->control->epoch == epoch->number &&
                           DDX_EPOCH_OK(epoch->number);
    if (!epoch->control_ready) {
        refuse(client, NOT_OURS);
        return;
    }
    client->offered_notice_fd = ddx_packet_take(packet, 1);
    client->offered_seen = packet->message.index;
    DDX_PASS(STORE_TAKEN);
}

static void take_slot(struct client *client, struct ddx_packet *packet) {
    struct epoch *epoch = client->offered;
    unsigned slot = packet->message.index;

    if (!epoch || slot >= DDX_SLOTS_MAX || epoch->slot_fd[slot] >= 0 ||
        !memfd_name_is(packet->fd[0], memfd_name_of_slot(client->item->name, epoch, slot)) ||
        !ddx_memory_sound(packet->fd[0], epoch->runs.file_bytes, true))
        return;
    epoch->slot_fd[slot] = ddx_packet_take(packet, 0);
    epoch->slot_told[slot] = epoch->slot_ready[slot] = true;
    epoch->slots++;
    DDX_PASS(STORE_TAKEN_SLOT);
}

/*
 * Another holder of an epoch that the store knows. It may have slots that the store does not know; and if it is the
 * writer, it may lack slots whose messages were lost with its connection. True if readers must be notified.
 */
static bool merge(struct epoch *known, struct epoch *offered, bool by_writer) {
    bool changed = false;

    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++) {
        bool has = offered->slot_fd[i] >= 0;

        if (known->slot_fd[i] < 0 && has) {
            known->slot_fd[i] = offered->slot_fd[i];
            known->slots++;
            offered->slot_fd[i] = -1;
        } else if (!has || known->slot_ready[i]) {
            known->slot_told[i] &= has || !by_writer;
            continue;
        }
        known->slot_told[i] = known->slot_ready[i] = changed = true;
    }
    return changed;
}

static bool is_current(const struct item *item, const struct epoch *epoch) {
    return item->epoch && (item->epoch == epoch || ddx_memory_same(item->epoch->control_fd, epoch->control_fd));
}

/* Whether the budget has room for the item with this epoch instead of its own. */
static bool is_affordable(struct item *item, struct epoch *epoch) {
    struct epoch *former = item->epoch;

    item->epoch = epoch;
    uint64_t reserved = item_reserved(item);
    item->epoch = former;
    return budget_allows(item, reserved);
}

/* The writer of an epoch that has turned out not to be the newest. */
static void supersede(struct item *item) {
    struct ddx_message message = {.operation = DDX_OFFERED, .status = -EEXIST};
    struct client *writer = item->writer;

    item->writer = NULL;
    if (writer)
        client_send(writer, &message, NULL, NULL, 0);
}

/* 1: the readers that reported before must be notified. 0: no change. -ENOSPC: no memory. */
static int adopt_epoch(struct item *item, struct client *client, bool writes) {
    struct epoch *epoch = client->offered;

    if (!epoch)
        return 0;
    if (is_current(item, epoch)) {
        bool changed = merge(item->epoch, epoch, writes && !item->writer);
        DDX_PASS(STORE_MERGED);
        return changed;
    }
    /* An epoch that began since this store runs is the newest. Otherwise the highest number is: a writer that was
     * stopped during a change of writer reports an older one, and continues to write until it is notified. */
    if (item->epoch && (!item->foreign || item->pending || epoch->number < item->epoch->number ||
                        (epoch->number == item->epoch->number && (!writes || item->writer))))
        return 0;
    if (!is_affordable(item, epoch))
        return -ENOSPC;
    supersede(item);
    item_begin_epoch(item, epoch);
    item->adopted = item->foreign = true;
    client->offered = NULL;
    DDX_PASS(STORE_ADOPTED);
    log_line("%s: taken back from %d", item->name, (int)client->pid);
    return true;
}

/* `current`: the client writes the item's current epoch. */
static int adopt_writer(struct item *item, struct client *client, bool current) {
    if (item->writer || item->pending || (item->epoch && !current))
        return -EEXIST;
    if (!item->epoch || !memfd_name_is(client->offered_notice_fd, memfd_name_of(item->name, "notice")) ||
        !ddx_memory_sound(client->offered_notice_fd, ddx_page_round(1), false))
        return -EINVAL;
    int result = item_set_notice(item, client->offered_notice_fd);
    client->offered_notice_fd = -1;
    if (result)
        return result;
    /* The writer may have received messages of the former store, which died before it changed the notice. */
    if ((int32_t)(client->offered_seen - item->announced) > 0)
        item->announced = item->taken = client->offered_seen;
    item->writer = client;
    item->adopted = item->away = false;
    reader_add_slots(item, 0, 0); /* for readers that returned before it */
    notify_slots(item, item->epoch, client);
    notify_readers(item);
    readers_count(item);
    DDX_PASS(STORE_WRITER_BACK);
    return 0;
}

/* Whether a reader with this pin page is known already. */
static bool has_reader(const struct item *item, int pin_fd) {
    for (const struct client *c = NULL; (c = item_next_reader(item, c));)
        if (ddx_memory_same(c->pin_fd, pin_fd))
            return true;
    return false;
}

static int adopt_reader(struct item *item, struct client *client) {
    unsigned keep = client->offered_keep, least = keep < DDX_PINS ? keep : DDX_PINS;
    int fd = client->offered_pin_fd;

    if (client->id || keep < 1 || keep > DDX_READERS_MAX || !memfd_name_is(fd, memfd_name_of(item->name, "pin")) ||
        !ddx_memory_sound(fd, ddx_page_round(1), true))
        return -EINVAL;
    if (has_reader(item, fd))
        return -EEXIST;
    /* Other readers may have its share by now: it gets the rest, but at least one frame for each pin. */
    while (reader_add_slots(item, keep, 1)) {
        if (keep == least)
            return -EBUSY;
        keep = keep / 2 > least ? keep / 2 : least;
    }
    if (keep < client->offered_keep)
        log_line("%s: %u frames are kept for its reader %d, not %u: other readers have the memory", item->name, keep,
                 (int)client->pid, client->offered_keep);
    client->offered_pin_fd = -1;
    int result = reader_register(client, fd, keep);
    if (!result && !item->writer)
        reader_taken(client, 0);
    DDX_PASS(STORE_READER_BACK);
    return result;
}

/* For a writer that was replaced: the number of its last frame that was carried over. */
static void tell_end(const struct item *item, const struct epoch *offered, struct ddx_message *reply) {
    const struct ended *ended = offered ? &item->ended[offered->number % ENDED] : NULL;

    if (ended && ended->epoch == offered->number) {
        reply->sequence = ended->sequence;
        reply->flags = DDX_FLAG_WRITER;
    }
}

static void finish(struct client *client, uint32_t flags) {
    struct item *item = client->item;
    struct ddx_message reply = {.operation = DDX_OFFERED};

    struct epoch *offered = client->offered;
    int changed = adopt_epoch(item, client, flags & DDX_FLAG_WRITER);
    if (changed < 0) {
        refuse(client, NO_ROOM);
        return;
    }
    /* The writer must know the readers before they get its epoch: from then on they may pin. */
    if (flags & DDX_FLAG_WRITER)
        reply.status = adopt_writer(item, client, offered && is_current(item, offered));
    if (reply.status && reply.status != -EEXIST)
        refuse(client, reply.status == -EINVAL ? NOT_OURS : NO_MEMORY);
    if (changed)
        notify_epoch_to_all(item);
    if (reply.status == -EEXIST)
        tell_end(item, client->offered, &reply);
    int result = flags & DDX_FLAG_READER && !client->gone ? adopt_reader(item, client) : 0;
    if (result && !client->gone)
        refuse(client, result == -EBUSY ? NO_ROOM : result == -ENOMEM ? NO_MEMORY : NOT_OURS);
    if (client->gone)
        return;
    offer_abandon(client);
    client_send(client, &reply, NULL, NULL, 0);
}

void offer_message(struct client *client, struct ddx_packet *packet) {
    const struct ddx_message *m = &packet->message;

    if (packet->cut && client->item) { /* an offer without all of its files would be an incomplete item */
        descriptors_for_item(client->item, OFFERED);
        refuse(client, NO_DESCRIPTOR);
        return;
    }
    switch (m->operation) {
    case DDX_OFFER: {
        const struct ddx_layout *layout = ddx_packet_layout(packet);

        bool awaits = m->flags & DDX_FLAG_AWAIT && !*m->type;
        if (client->item || !(awaits || (layout && ddx_type_name_ok(m->type))) || !ddx_item_name_ok(m->name))
            return;
        struct item *item = item_find(client->store, m->name);
        if (item && !item_is_awaited(item) && !awaits && strcmp(item->type, m->type) != 0) {
            client->gone = true; /* another item has this name by now */
            return;
        }
        if (item && item_is_awaited(item) && !awaits && item_define(item, m->type, layout))
            return;
        client->item = item ? item : item_add(client->store, m->name, m->type, awaits ? NULL : layout);
        if (!client->item)
            return;
        client->item->handles++;
        if (packet->cut)
            refuse(client, NO_DESCRIPTOR);
        else if (packet->fd[0] >= 0 && !awaits)
            take_control(client, packet, layout);
        break;
    }
    case DDX_OFFER_SLOT: take_slot(client, packet); break;
    case DDX_OFFER_PIN:
        if (client->offered_pin_fd < 0)
            client->offered_pin_fd = ddx_packet_take(packet, 0);
        client->offered_keep = m->frames;
        break;
    default:
        if (client->item)
            finish(client, m->flags);
        break;
    }
    if (!client->gone && client->item && client_holds_too_much(client))
        refuse(client, "too many files are offered at once, and other clients need descriptors");
}
