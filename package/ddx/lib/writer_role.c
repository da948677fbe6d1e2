/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "roles.h"

#include <errno.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "handle.h"
#include "fault.h"

/* ---- Readers ---- */

/* The readers whose pins a writer checks: admitting and removing them. With `lock` held. */

static void send_taken(DDX_STORE_ITEM *item, const struct ddx_message *reader, int status) {
    struct ddx_message message;

    ddx_message_init(&message, DDX_TAKEN, item);
    message.index = reader->index;
    message.sequence = reader->sequence;
    message.status = status;
    ddx_connection_say(item, &message, NULL, NULL, 0);
    DDX_PASS(CLAIM_TAKEN);
}

/* Add a reader to the list, with its page mapped. Its index, or -errno. */
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
 * If this program was stopped for too long, the store may have admitted a reader whose pins cannot be checked: until
 * that reader is refused, or its page can be mapped, no frame may be overwritten.
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
 * The store admits the reader once this writer has answered that it checks the reader's pins. A writer without a
 * descriptor for the page, or for the slots added for the reader, refuses the reader: writing comes first.
 */
void ddx_writer_on_reader(DDX_STORE_ITEM *item, struct ddx_packet *packet) {
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
 * A reader left; or, with DDX_FLAG_CREATE, all readers left that have not returned after the store's restart. A number
 * is valid only with the store that assigned it: a reader that has not returned yet has its former number, which may
 * belong to another reader by now.
 */
void ddx_writer_on_reader_gone(struct ddx_writer_role *writer, const struct ddx_message *m) {
    see(writer, m->size, false);
    for (unsigned i = writer->ring.reader_count; i-- > 0;)
        if (m->flags & DDX_FLAG_CREATE ? !writer->confirmed[i]
                                       : writer->confirmed[i] && writer->ring.reader[i].id == m->index) {
            writer->leaving_count += !writer->leaving[i];
            writer->leaving[i] = true;
        }
    ddx_writer_forget(writer, false);
}

/* ---- Writer ---- */

/* `status`: -errno if this program cannot map the slot. */
static void send_ready(DDX_STORE_ITEM *item, uint32_t epoch, unsigned slot, int status) {
    struct ddx_message message;

    ddx_message_init(&message, DDX_READY, item);
    message.epoch = epoch;
    message.index = slot;
    message.status = status;
    ddx_connection_say(item, &message, NULL, NULL, 0);
    DDX_PASS(CLAIM_READY);
}

void ddx_writer_on_claimed(DDX_STORE_ITEM *item, struct ddx_packet *packet) {
    struct ddx_writer_role *writer = &item->writer;
    const struct ddx_message *m = &packet->message;
    const struct ddx_layout *layout = ddx_packet_layout(packet);
    struct ddx_term *term;

    if (writer->term || !layout)
        return;
    int result =
        packet->cut ? -EMFILE : ddx_term_new(&term, m->epoch, layout, item->own, ddx_packet_take(packet, 0), true);
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
    /* Not the version in the notice now: it may count announcements of readers that follow this message. */
    writer->ring.notice_seen = m->index;
    DDX_PASS(CLAIM_CONTROL);
    send_ready(item, m->epoch, DDX_NO_SLOT, 0);
}

void ddx_writer_on_slot(DDX_STORE_ITEM *item, struct ddx_packet *packet) {
    const struct ddx_message *m = &packet->message;
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
}

void ddx_writer_on_slot_told(struct ddx_writer_role *writer, const struct ddx_message *m) {
    struct ddx_ring_writer *ring = &writer->ring;

    if (!writer->term || writer->term->epoch != m->epoch)
        return;
    for (unsigned i = ring->told_count; i < ring->slot_count; i++)
        if (ring->slot[i] == m->index) {
            ring->slot[i] = ring->slot[ring->told_count];
            ring->slot[ring->told_count++] = (uint8_t)m->index;
            return;
        }
}

void ddx_writer_on_done(struct ddx_writer_role *writer, const struct ddx_message *m) {
    if (!m->status)
        writer->ring.told_count = writer->ring.slot_count;
}

void ddx_writer_on_offered(struct ddx_writer_role *writer, const struct ddx_message *m) {
    /* Not the slots added since the offer. */
    if (!m->status && writer->ring.told_count < writer->offered)
        writer->ring.told_count = writer->offered;
    if (m->status == -EEXIST) {
        writer->superseded = true;
        if (m->flags & DDX_FLAG_WRITER && writer->ring.sequence > m->sequence)
            writer->lost = writer->ring.sequence - m->sequence;
        DDX_PASS(KEEPER_SUPERSEDED);
    }
    DDX_PASS(KEEPER_ACCEPTED);
}

void ddx_writer_end(struct ddx_writer_role *writer) {
    if (!writer->term)
        return;
    if (writer->loaned >= 0)
        ddx_ring_cancel(&writer->ring, (unsigned)writer->loaned);
    writer->loaned = -1;
    for (unsigned i = 0; i < writer->ring.reader_count; i++) {
        munmap((void *)(uintptr_t)writer->ring.reader[i].page, sizeof(struct ddx_pin_page));
        close(writer->pin_fd[i]);
    }
    munmap(writer->notice, sizeof(struct ddx_notice));
    close(writer->notice_fd);
    if (writer->hold_fd >= 0)
        close(writer->hold_fd);
    ddx_term_free(writer->term);
    writer->term = NULL;
    writer->notice = NULL;
    writer->notice_fd = writer->hold_fd = -1;
    writer->leaving_count = 0;
    writer->refused = false;
    writer->unseen_count = 0;
    DDX_PASS(CLAIM_ENDED);
}
