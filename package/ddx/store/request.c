/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <string.h>
#include <unistd.h>

#include "../lib/fault.h"
#include "adopt.h"
#include "budget.h"
#include "claim.h"
#include "epoch.h"
#include "holder.h"
#include "items.h"
#include "readers.h"
#include "request.h"
#include "send.h"

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
