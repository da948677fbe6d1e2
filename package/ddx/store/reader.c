/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <string.h>
#include <sys/mman.h>

#include "files.h"
#include "server.h"

int reader_add_slots(struct item *item, unsigned keep, unsigned pages) {
    struct epoch *epoch = item->pending ? item->pending : item->epoch;
    unsigned wanted = 2 + item->kept + keep;

    if (wanted > DDX_SLOTS_MAX || item->readers + pages > DDX_READERS_MAX)
        return -EBUSY;
    if (!epoch) /* nobody has written it: it is not known how large its frames will be */
        return budget_allows(item, item_reserved(item) + pages * ddx_page_round(1)) ? 0 : -EBUSY;
    unsigned more = item->writer && wanted > epoch->slots ? wanted - epoch->slots : 0;
    uint64_t cost = (more + keep) * epoch->runs.file_bytes + pages * ddx_page_round(1);
    if (!budget_allows(item, item_reserved(item) + cost))
        return -EBUSY;
    if (!more)
        return 0;
    if (epoch_add_slots(epoch, item->name, more))
        return -EBUSY;
    DDX_PASS(STORE_ROOM);
    item_send_new_slots(item, epoch, item->writer);
    return 0;
}

void readers_count(struct item *item) {
    const struct epoch *epoch = item->epoch;
    bool kept = epoch && epoch_ready(epoch) && epoch->slots >= 2 + item->kept;
    uint32_t count = 0;

    for (struct client *c = store->clients; c; c = c->next)
        if (c->item == item && c->id) {
            c->counted |= kept;
            count += c->counted;
        }
    item->counted = count;
}

void readers_tell(void) {
    for (const struct item *item = store->items; item; item = item->next)
        if (item->notice && atomic_load_explicit(&item->notice->readers, memory_order_relaxed) != item->counted)
            atomic_store(&item->notice->readers, item->counted);
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
    client->id = ++store->next_reader;
    client->keep = keep;
    if (item->writer)
        item_announce(item, client);
    client->counted = false;
    item->kept += keep;
    item->readers++;
    DDX_PASS(STORE_REGISTERED);
    return 0;
}

static int attach(struct client *client, unsigned keep) {
    struct item *item = client->item;

    if (keep < 1 || keep > DDX_READERS_MAX)
        return -EINVAL;
    /* Whose writer lives, but is not heard (it has not reported since we started, or stopped listening): it would not
     * look at the new pins. Nor while another one gets ready to replace it: until then its frames are the item's. */
    if (item->epoch && (!item->writer || item->pending) && ddx_memory_held(item->epoch->control_fd) &&
        !DDX_BROKEN("unheard"))
        return -EAGAIN;
    int result = reader_add_slots(item, keep, client->id ? 0 : 1);
    if (result) {
        clients_reap();
        result = reader_add_slots(item, keep, client->id ? 0 : 1);
    }
    if (result)
        return result;
    if (client->id) {
        client->keep += keep;
        item->kept += keep;
        /* The writer must have the new slots before it meets the new pins, or it runs out of free ones. */
        if (item->writer)
            item_announce(item, client);
        return 0;
    }
    int fd = ddx_memory_create(label_of(item->name, "pin"), ddx_page_round(1));
    return fd < 0 ? -EBUSY : reader_register(client, fd, keep);
}

void reader_attach(struct client *client, unsigned keep) {
    struct item *item = client->item;
    struct ddx_message message = {.operation = DDX_ATTACHED};
    struct ddx_ring_frame frame;
    bool before = client->id != 0;

    /* Before the writer hears of the reader: what is written from then on must count as not yet seen. */
    message.sequence = item->epoch && ddx_ring_peek(item->epoch->control, &frame) ? frame.sequence : item->sequence;
    message.status = attach(client, keep);
    strcpy(message.name, item->name);
    if (message.status || before) {
        client_send(client, &message, NULL, NULL, 0);
        return;
    }
    if (item->epoch)
        item_send_epoch(item, client);
    client_send(client, &message, NULL, &client->pin_fd, 1);
    readers_count(item); /* unless it has to wait for the writer: see writer_ready() */
}

void reader_left(struct client *client) {
    struct item *item = client->item;
    struct ddx_message message = {.operation = DDX_READER_GONE, .index = client->id};

    if (!client->id)
        return;
    munmap((void *)(uintptr_t)client->pin, sizeof *client->pin);
    file_close(client->pin_fd);
    client->id = 0;
    item->readers--;
    item->kept -= client->keep;
    DDX_PASS(STORE_READER_LEFT);
    if (item->writer && !item->writer->gone)
        client_send(item->writer, &message, NULL, NULL, 0);
    readers_count(item);
}
