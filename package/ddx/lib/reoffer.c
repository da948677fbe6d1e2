/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "reoffer.h"

#include "fault.h"
#include "connection.h"

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

int ddx_item_reoffer(DDX_STORE_ITEM *item) {
    int result = ddx_connection_open(item);

    if (result)
        return result;
    DDX_PASS(KEEPER_FOUND);
    return offer(item);
}
