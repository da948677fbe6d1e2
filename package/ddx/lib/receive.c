/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "roles.h"

#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "handle.h"
#include "fault.h"
#include "futex.h"

/* ---- After a restart of the store ---- */

/*
 * A restarted store knows no items. Each holder of an item offers its memory files, from which the new store
 * reconstructs the item. Frames continue to flow.
 */

static int offer_term(DDX_STORE_ITEM *item, const struct ddx_term *term, uint32_t flags) {
    int fds[2] = {term->control_fd, item->writer.notice_fd};
    struct ddx_message message;
    int result;

    ddx_message_init(&message, DDX_OFFER, item);
    message.flags = flags;
    message.epoch = term->epoch;
    message.index = flags & DDX_FLAG_WRITER ? item->writer.ring.notice_seen : 0;
    message.sequence = flags & DDX_FLAG_WRITER ? item->writer.ring.sequence : item->reader.seen;
    result = ddx_connection_say(item, &message, term->layout, fds, flags & DDX_FLAG_WRITER ? 2 : 1);
    item->writer.offered = flags & DDX_FLAG_WRITER ? item->writer.ring.slot_count : 0;
    DDX_PASS(KEEPER_OFFERED);
    for (unsigned i = 0; i < DDX_SLOTS_MAX && !result; i++) {
        if (!term->base[i])
            continue;
        ddx_message_init(&message, DDX_OFFER_SLOT, item);
        message.epoch = term->epoch;
        message.index = i;
        result = ddx_connection_say(item, &message, NULL, &term->fd[i], 1);
        DDX_PASS(KEEPER_SLOT);
    }
    return result;
}

static int offer(DDX_STORE_ITEM *item) {
    const struct ddx_reader_role *reader = &item->reader;
    const struct ddx_term *term = item->writer.term;
    struct ddx_message message;
    uint32_t flags = reader->page ? DDX_FLAG_READER : 0;
    int result;

    if (term && !item->writer.superseded)
        flags |= DDX_FLAG_WRITER;
    else
        term = reader->coming && !reader->coming->slots_coming ? reader->coming : reader->term;
    if (!flags || !term) {
        ddx_message_init(&message, flags ? DDX_OFFER : DDX_OPEN, item);
        message.flags = flags | (*item->type ? DDX_FLAG_CREATE : DDX_FLAG_AWAIT);
        result = ddx_connection_say(item, &message, *item->type ? item->layout : NULL, NULL, 0);
    } else
        result = offer_term(item, term, flags);
    if (!result && reader->page) {
        ddx_message_init(&message, DDX_OFFER_PIN, item);
        message.frames = reader->keep + reader->both;
        message.sequence = reader->seen;
        result = ddx_connection_say(item, &message, NULL, &reader->pin_fd, 1);
        DDX_PASS(KEEPER_PIN);
    }
    if (!result && flags) {
        ddx_message_init(&message, DDX_OFFER_END, item);
        message.flags = flags;
        result = ddx_connection_say(item, &message, NULL, NULL, 0);
        DDX_PASS(KEEPER_END);
    }
    return result;
}

/*
 * Connect, and send the whole offer. With `lock` held. 0, or -errno: the store does not listen or, if item->socket is
 * open nevertheless, has disconnected.
 */
static int ddx_item_reoffer(DDX_STORE_ITEM *item) {
    int result = ddx_connection_open(item);

    if (result)
        return result;
    DDX_PASS(KEEPER_FOUND);
    return offer(item);
}

/* ---- Messages ---- */

static void handle(DDX_STORE_ITEM *item, struct ddx_packet *packet);

/*
 * Shut down, because close() has no effect while the keeper polls the socket: the store must not send messages that are
 * never read. Earlier messages count, since they may announce readers that the store has admitted.
 */
static void hang_up(DDX_STORE_ITEM *item) {
    int result;

    shutdown(item->socket, SHUT_RDWR);
    while ((result = ddx_receive(item->socket, item->packet)) > 0 || result == -EPROTO)
        if (result > 0)
            handle(item, item->packet);
    close(item->socket);
}

void ddx_item_disconnect(DDX_STORE_ITEM *item) {
    if (item->socket >= 0)
        hang_up(item);
    item->socket = -1;
    ddx_queue_clear(&item->queue);
    item->retry = ddx_time_now();
    /* The store will announce living readers again, which confirms them; the others may have died. */
    memset(item->writer.confirmed, 0, sizeof item->writer.confirmed);
    ddx_futex_change(&item->changed);
    DDX_PASS(KEEPER_LOST);
}

static void on_slot(DDX_STORE_ITEM *item, struct ddx_packet *packet) {
    const struct ddx_message *m = &packet->message;

    if ((m->flags & DDX_FLAG_WRITER) && (m->flags & DDX_FLAG_READER))
        ddx_writer_on_slot_told(&item->writer, m);
    else if (m->flags & DDX_FLAG_WRITER)
        ddx_writer_on_slot(item, packet);
    else
        ddx_reader_on_slot(&item->reader, packet);
}

static void handle(DDX_STORE_ITEM *item, struct ddx_packet *packet) {
    struct ddx_message *m = &packet->message;
    const struct ddx_layout *layout;

    if (m->number && m->number <= item->heard) { /* sent twice: the store's worker died in between */
        ddx_packet_close(packet);
        return;
    }
    item->heard = m->number ? m->number : item->heard;
    /* A reader without a descriptor for an announced file must get the announcement again when descriptors are free. */
    if (packet->cut && (m->operation == DDX_EPOCH || (m->operation == DDX_SLOT && m->flags == DDX_FLAG_READER)))
        item->lost_files = true;
    switch (m->operation) {
    case DDX_OPENED:
        if ((layout = ddx_packet_layout(packet)) && ddx_item_set_layout(item, layout))
            m->status = -ENOMEM;
        if (!m->status)
            strcpy(item->type, m->type);
        break;
    case DDX_CLAIMED: ddx_writer_on_claimed(item, packet); break;
    case DDX_EPOCH: ddx_reader_on_epoch(item, packet); break;
    case DDX_SLOT: on_slot(item, packet); break;
    case DDX_READER: ddx_writer_on_reader(item, packet); break;
    case DDX_READER_GONE: ddx_writer_on_reader_gone(&item->writer, m); break;
    case DDX_ATTACHED: ddx_reader_on_attached(&item->reader, packet); break;
    case DDX_DONE: ddx_writer_on_done(&item->writer, m); break;
    case DDX_OFFERED: ddx_writer_on_offered(&item->writer, m); break;
    default: break;
    }
    if (m->operation == item->answer) {
        item->reply = *m;
        item->answered = true;
    }
    ddx_packet_close(packet);
}

int ddx_item_service(DDX_STORE_ITEM *item) {
    bool any = false;
    int result;

    if (item->socket < 0)
        return -EPIPE;
    while ((result = ddx_receive(item->socket, item->packet)) > 0) {
        handle(item, item->packet);
        any = true;
    }
    if (any)
        ddx_futex_change(&item->changed);
    if (result >= 0 && !item->lost_files)
        return 0;
    ddx_item_disconnect(item);
    if (item->lost_files) /* there may be descriptors next time; the store then announces everything again */
        item->retry += DDX_RETRY_NS;
    return -EPIPE;
}

int ddx_item_reconnect(DDX_STORE_ITEM *item) {
    int result = ddx_item_reoffer(item);

    if (result && item->socket >= 0)
        ddx_item_disconnect(item);
    return result;
}

int ddx_item_request(DDX_STORE_ITEM *item, const struct ddx_message *message, const struct ddx_layout *layout,
                     uint32_t answer) {
    int64_t deadline = ddx_time_now() + DDX_ANSWER_NS;

    if (item->socket < 0 && ddx_item_reconnect(item))
        return -ECONNREFUSED;
    item->answer = answer;
    item->answered = false;
    int result = ddx_queue_send(&item->queue, item->socket, message, layout, NULL, 0);
    if (message->operation == DDX_CLAIM)
        DDX_PASS(CLAIM_SENT);
    if (message->operation == DDX_ATTACH)
        DDX_PASS(ATTACH_SENT);
    while (!result && !item->answered) {
        struct pollfd wait = {.fd = item->socket, .events = (short)(POLLIN | ddx_queue_events(&item->queue))};
        int64_t left = deadline - ddx_time_now();

        if (left <= 0)
            result = -ETIMEDOUT;
        else {
            poll(&wait, 1, item->queue.crowded ? DDX_QUEUE_PAUSE_MS : (int)(left / 1000000) + 1);
            result = ddx_queue_go_on(&item->queue, item->socket, NULL, NULL);
            if (!result)
                result = ddx_item_service(item);
        }
    }
    if (result)
        ddx_item_service(item); /* the store's last messages: it may have admitted a reader */
    item->answer = 0;
    if (item->answered)
        return item->reply.status;
    if (item->socket >= 0)
        ddx_item_disconnect(item);
    return -ECONNREFUSED;
}
