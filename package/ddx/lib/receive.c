/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "receive.h"

#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "fault.h"
#include "futex.h"
#include "reoffer.h"
#include "reader_role.h"
#include "writer_readers.h"
#include "writer_role.h"

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
        item->deaf = true;
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
    if (result >= 0 && !item->deaf)
        return 0;
    ddx_item_disconnect(item);
    if (item->deaf) /* there may be descriptors next time; the store then announces everything again */
        item->retry += DDX_RETRY;
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
    int64_t deadline = ddx_time_now() + DDX_ANSWER_WAIT;

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
            poll(&wait, 1, item->queue.crowded ? DDX_QUEUE_PAUSE : (int)(left / 1000000) + 1);
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
