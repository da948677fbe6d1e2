/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Taking in what the store says: answers to requests, and news. */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include "fault.h"
#include "item.h"
#include "link.h"
#include "reader_role.h"
#include "term.h"

static void handle(DDX_STORE_ITEM *item, struct ddx_packet *packet);

/*
 * The keeper may be looking at the socket, which keeps it open: shut down, so that the store cannot say anything more
 * that nobody hears. What it said before counts: it has let readers in.
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
    /* Readers that the store tells us of again are confirmed; the others may have died meanwhile. */
    memset(item->writer.confirmed, 0, sizeof item->writer.confirmed);
    ddx_futex_change(&item->changed);
    DDX_PASS(KEEPER_LOST);
}

/* `status`: an error if there will never be such a slot. */
static void send_ready(DDX_STORE_ITEM *item, uint32_t epoch, unsigned slot, int status) {
    struct ddx_message message;

    ddx_message_init(&message, DDX_READY, item);
    message.epoch = epoch;
    message.index = slot;
    message.status = status;
    ddx_link_say(item, &message, NULL, NULL, 0);
    DDX_PASS(CLAIM_READY);
}

static void send_taken(DDX_STORE_ITEM *item, const struct ddx_message *reader, int status) {
    struct ddx_message message;

    ddx_message_init(&message, DDX_TAKEN, item);
    message.index = reader->index;
    message.sequence = reader->sequence;
    message.status = status;
    ddx_link_say(item, &message, NULL, NULL, 0);
    DDX_PASS(CLAIM_TAKEN);
}

/* This handle's claim was granted: its term as the writer begins. */
static void on_claimed(DDX_STORE_ITEM *item, struct ddx_packet *packet) {
    struct ddx_writer_role *writer = &item->writer;
    const struct ddx_message *m = &packet->message;
    const struct ddx_layout *layout = ddx_packet_layout(packet);
    struct ddx_term *term;

    if (writer->term || !layout)
        return;
    int result = packet->cut ? -EMFILE
                             : ddx_term_new(&term, m->epoch, layout, item->own, ddx_packet_take(packet, 0), true);
    if (result) {
        send_ready(item, m->epoch, DDX_NO_SLOT, result);
        return;
    }
    writer->notice = ddx_memory_map(packet->fd[1], sizeof(struct ddx_notice), false);
    if (!writer->notice || ddx_item_set_layout(item, layout)) {
        if (writer->notice)
            munmap(writer->notice, sizeof(struct ddx_notice));
        writer->notice = NULL;
        ddx_term_free(term);
        send_ready(item, m->epoch, DDX_NO_SLOT, -ENOMEM);
        return;
    }
    writer->notice_fd = ddx_packet_take(packet, 1);
    writer->hold_fd = ddx_memory_hold(term->control_fd);
    writer->term = term;
    writer->loaned = -1;
    writer->superseded = false;
    writer->lost = 0;
    memset(&writer->ring, 0, sizeof writer->ring);
    writer->ring.control = term->control;
    writer->ring.notice = writer->notice;
    writer->ring.epoch = m->epoch;
    writer->ring.sequence = m->sequence;
    /* Not what the notice says now: news about readers may already stand behind this message. */
    writer->ring.notice_seen = m->index;
    DDX_PASS(CLAIM_CONTROL);
    send_ready(item, m->epoch, DDX_NO_SLOT, 0);
}

static void on_slot_told(struct ddx_ring_writer *ring, unsigned slot) {
    for (unsigned i = ring->told_count; i < ring->slot_count; i++)
        if (ring->slot[i] == slot) {
            ring->slot[i] = ring->slot[ring->told_count];
            ring->slot[ring->told_count++] = (uint8_t)slot;
            return;
        }
}

static void on_slot(DDX_STORE_ITEM *item, struct ddx_packet *packet) {
    const struct ddx_message *m = &packet->message;

    if ((m->flags & DDX_FLAG_WRITER) && (m->flags & DDX_FLAG_READER)) {
        if (item->writer.term && item->writer.term->epoch == m->epoch)
            on_slot_told(&item->writer.ring, m->index);
        return;
    }
    if (m->flags & DDX_FLAG_WRITER) {
        struct ddx_ring_writer *ring = &item->writer.ring;
        struct ddx_term *term = item->writer.term;

        if (!term || term->epoch != m->epoch)
            return;
        int result = ddx_term_add_slot(term, m->index, ddx_packet_take(packet, 0));

        if (result) {
            if (!term->base[m->index % DDX_SLOTS_MAX]) {
                item->writer.refused = true;
                send_ready(item, m->epoch, m->index, packet->cut ? -EMFILE : result);
            }
            return;
        }
        ring->slot[ring->slot_count++] = (uint8_t)m->index;
        if (m->index >= atomic_load_explicit(&ring->control->slots, memory_order_relaxed))
            atomic_store_explicit(&ring->control->slots, m->index + 1, memory_order_release);
        DDX_PASS(CLAIM_SLOT);
        send_ready(item, m->epoch, m->index, 0);
        return;
    }
    ddx_reader_on_slot(&item->reader, packet);
}

/* Room in the list for a reader, with its page mapped; or -errno. */
static int add_reader(struct ddx_writer_role *writer, struct ddx_packet *packet) {
    struct ddx_ring_writer *ring = &writer->ring;
    unsigned i = ring->reader_count;

    if (packet->fd[0] < 0)
        return packet->cut ? -EMFILE : -EPROTO;
    if (i == DDX_READERS_MAX || !ddx_memory_sound(packet->fd[0], ddx_page_round(1), false))
        return -EBUSY;
    const void *page = ddx_memory_map(packet->fd[0], sizeof(struct ddx_pin_page), false);
    if (!page)
        return -errno;
    writer->pin_fd[i] = ddx_packet_take(packet, 0);
    writer->leaving[i] = false;
    ring->reader[i] = (struct ddx_ring_reader){.page = page};
    ring->reader_count++;
    return (int)i;
}

/*
 * A reader whose pins cannot be looked at may have been let in all the same, since we were stopped for too long: until
 * it is refused, or can be seen, no frame may be written over.
 */
static void see(struct ddx_writer_role *writer, uint64_t page, bool unseen) {
    unsigned i = 0;

    while (i < writer->unseen_count && writer->unseen[i] != page)
        i++;
    if (!unseen && i < writer->unseen_count)
        writer->unseen[i] = writer->unseen[--writer->unseen_count];
    else if (unseen && i == writer->unseen_count && i < DDX_READERS_MAX)
        writer->unseen[writer->unseen_count++] = page;
}

/*
 * It is let in when we have said that we look at its pins. A program without a descriptor for its page, or for the
 * frames that were to be added for it, refuses it instead: what is written comes first.
 */
static void on_reader(DDX_STORE_ITEM *item, struct ddx_packet *packet) {
    struct ddx_writer_role *writer = &item->writer;
    struct ddx_ring_writer *ring = &writer->ring;
    const struct ddx_message *m = &packet->message;
    bool refused = writer->refused;
    int i = 0;

    if (ring->reader_count == DDX_READERS_MAX)
        ddx_writer_forget(writer, true);
    writer->refused = false;
    ring->notice_seen = m->sequence ? (uint32_t)m->sequence : ring->notice_seen;
    while ((unsigned)i < ring->reader_count && ddx_memory_number(writer->pin_fd[i]) != m->size)
        i++;
    bool known = (unsigned)i < ring->reader_count;
    if (refused && (!known || m->frames > ring->reader[i].share))
        i = -EMFILE;
    else if (!known)
        i = add_reader(writer, packet);
    see(writer, m->size, i < 0 && !known);
    if (i < 0) {
        send_taken(item, m, i);
        return;
    }
    ring->reader[i].id = m->index;
    ring->reader[i].share = m->frames;
    writer->confirmed[i] = true;
    writer->leaving_count -= writer->leaving[i];
    writer->leaving[i] = false;
    DDX_PASS(CLAIM_READER);
    send_taken(item, m, 0);
}

static void drop_reader(struct ddx_writer_role *writer, unsigned i) {
    struct ddx_ring_writer *ring = &writer->ring;
    unsigned last = --ring->reader_count;

    munmap((void *)(uintptr_t)ring->reader[i].page, sizeof(struct ddx_pin_page));
    close(writer->pin_fd[i]);
    writer->leaving_count -= writer->leaving[i];
    writer->leaving[i] = writer->leaving[last];
    ring->reader[i] = ring->reader[last];
    writer->pin_fd[i] = writer->pin_fd[last];
    writer->confirmed[i] = writer->confirmed[last];
    DDX_PASS(CLAIM_READER_GONE);
}

bool ddx_writer_forget(struct ddx_writer_role *writer, bool all) {
    bool any = false;

    for (unsigned i = writer->ring.reader_count; i-- > 0;)
        if ((all || writer->leaving[i]) && !ddx_memory_held(writer->pin_fd[i])) {
            drop_reader(writer, i);
            any = true;
        }
    return any;
}

/*
 * A reader left; or, with DDX_FLAG_CREATE, those are gone who did not come back after the store's restart. A number
 * counts only with the store that gave it: a reader that has not come back yet keeps its former one, which is somebody
 * else's by now.
 */
static void on_reader_gone(DDX_STORE_ITEM *item, const struct ddx_message *m) {
    struct ddx_writer_role *writer = &item->writer;

    see(writer, m->size, false);
    for (unsigned i = writer->ring.reader_count; i-- > 0;)
        if (m->flags & DDX_FLAG_CREATE
                ? !writer->confirmed[i]
                : (writer->confirmed[i] || DDX_BROKEN("numbers")) && writer->ring.reader[i].id == m->index) {
            if (DDX_BROKEN("numbers")) {
                drop_reader(writer, i);
                continue;
            }
            writer->leaving_count += !writer->leaving[i];
            writer->leaving[i] = true;
        }
    ddx_writer_forget(writer, false);
}

static void handle(DDX_STORE_ITEM *item, struct ddx_packet *packet) {
    struct ddx_message *m = &packet->message;
    const struct ddx_layout *layout;

    if (m->number && m->number <= item->heard) { /* said twice: the store's worker has died in between */
        ddx_packet_close(packet);
        return;
    }
    item->heard = m->number ? m->number : item->heard;
    /* A reader without a descriptor for what it is told of has to be told anew when there are some. */
    if (packet->cut && (m->operation == DDX_EPOCH || (m->operation == DDX_SLOT && m->flags == DDX_FLAG_READER)))
        item->deaf = true;
    switch (m->operation) {
    case DDX_OPENED:
        if ((layout = ddx_packet_layout(packet)) && ddx_item_set_layout(item, layout))
            m->status = -ENOMEM;
        if (!m->status)
            strcpy(item->type, m->type);
        break;
    case DDX_CLAIMED: on_claimed(item, packet); break;
    case DDX_EPOCH: ddx_reader_on_epoch(item, packet); break;
    case DDX_SLOT: on_slot(item, packet); break;
    case DDX_READER: on_reader(item, packet); break;
    case DDX_READER_GONE: on_reader_gone(item, m); break;
    case DDX_ATTACHED: ddx_reader_on_attached(&item->reader, packet); break;
    case DDX_DONE:
        if (!m->status)
            item->writer.ring.told_count = item->writer.ring.slot_count;
        break;
    case DDX_OFFERED:
        /* Not those that it has added since. */
        if (!m->status && item->writer.ring.told_count < item->writer.offered)
            item->writer.ring.told_count = item->writer.offered;
        if (m->status == -EEXIST) {
            item->writer.superseded = true;
            if (m->flags & DDX_FLAG_WRITER && item->writer.ring.sequence > m->sequence)
                item->writer.lost = item->writer.ring.sequence - m->sequence;
            DDX_PASS(KEEPER_SUPERSEDED);
        }
        DDX_PASS(KEEPER_ACCEPTED);
        break;
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
    if (item->deaf) /* there may be descriptors next time; the store tells all anew then */
        item->retry += DDX_RETRY;
    return -EPIPE;
}

int ddx_item_request(DDX_STORE_ITEM *item, const struct ddx_message *message, const struct ddx_layout *layout,
                     uint32_t answer) {
    int64_t deadline = ddx_time_now() + DDX_ANSWER_WAIT;

    if (item->socket < 0 && ddx_item_offer(item))
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
        ddx_item_service(item); /* what it said before it died; it may have let somebody in */
    item->answer = 0;
    if (item->answered)
        return item->reply.status;
    if (item->socket >= 0)
        ddx_item_disconnect(item);
    return -ECONNREFUSED;
}
