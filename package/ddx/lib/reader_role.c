/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "reader_role.h"

#include <errno.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "fault.h"
#include "term.h"
#include "window.h"

DDX_HOT void ddx_reader_saw(struct ddx_reader_role *reader, uint64_t sequence) {
    reader->seen = sequence;
    if (reader->page)
        atomic_store_explicit(&reader->page->seen, (uint32_t)sequence, memory_order_relaxed);
}

DDX_COLD void ddx_reader_follow(struct ddx_reader_role *reader) {
    /* Not before all slots are announced: if the store dies earlier, the new epoch is useless, and only the former one
     * has the item's data. */
    if (!reader->coming || reader->held >= 0 || reader->coming->slots_coming)
        return;
    /* A reader in order reads the former epoch to its end. Frames that a replaced writer wrote later do not count. */
    if (reader->in_order && reader->term &&
        ddx_ring_left(reader->term->control, reader->term->base, reader->seen, reader->coming->former_last))
        return;
    /* A frame in the window remains valid until the next one arrives: no program writes into an ended epoch. */
    if (reader->term != reader->shown_term)
        ddx_term_free(reader->term);
    reader->term = reader->coming;
    reader->coming = NULL;
    if (reader->term->begins_again)
        ddx_reader_saw(reader, 0);
    DDX_PASS(ATTACH_FOLLOWED);
}

/* Set the type of a handle that awaited the item. 0, or -ENOMEM. */
static int learn_type(DDX_STORE_ITEM *item, const char *type) {
    if (!item->own && ddx_layout_of(type, &item->own) == -ENOMEM)
        return -ENOMEM;
    strcpy(item->type, type);
    return 0;
}

void ddx_reader_on_epoch(DDX_STORE_ITEM *item, struct ddx_packet *packet) {
    const struct ddx_layout *layout = ddx_packet_layout(packet);
    struct ddx_reader_role *reader = &item->reader;
    struct ddx_term *term = reader->coming ? reader->coming : reader->term;

    /* A restarted store announces the epoch that this handle has already; its numbers may be older than the ones seen
     * since. Slots that this handle lacks follow. */
    if (term && packet->fd[0] >= 0 && ddx_memory_same(term->control_fd, packet->fd[0])) {
        term->slots_coming = packet->message.index;
        return;
    }
    if (layout && !*item->type && learn_type(item, packet->message.type))
        return;
    if (!layout || ddx_term_new(&term, packet->message.epoch, layout, item->own, ddx_packet_take(packet, 0), false))
        return;
    /*
     * Numbers begin at 1 again if store and writer were both lost, or after a writer that used up the numbers; then the
     * last number seen is meaningless, but only in the new epoch: in the former one its frames would be new again.
     */
    term->begins_again =
        packet->message.sequence < reader->seen || (reader->coming && reader->coming->begins_again);
    /* The store had less memory than was requested before the frame's size was known. */
    if (packet->message.frames && packet->message.frames < reader->keep)
        reader->keep = packet->message.frames;
    term->slots_coming = packet->message.index;
    term->former_last = packet->message.missed;
    ddx_term_free(reader->coming);
    reader->coming = term;
    DDX_PASS(ATTACH_EPOCH);
    if (!reader->waiting) /* else the sleeper follows */
        ddx_reader_follow(reader);
}

void ddx_reader_on_slot(struct ddx_reader_role *reader, struct ddx_packet *packet) {
    const struct ddx_message *m = &packet->message;
    struct ddx_term *term = reader->coming ? reader->coming : reader->term;

    if (!term || term->epoch != m->epoch)
        return;
    if (!ddx_term_add_slot(term, m->index, ddx_packet_take(packet, 0)))
        DDX_PASS(ATTACH_SLOT);
    term->slots_coming -= term->slots_coming > 0;
    if (term == reader->coming && !reader->waiting) /* else the sleeper follows */
        ddx_reader_follow(reader);
}

void ddx_reader_on_attached(struct ddx_reader_role *reader, struct ddx_packet *packet) {
    if (packet->message.status || reader->page || packet->fd[0] < 0)
        return;
    reader->page = ddx_memory_map(packet->fd[0], sizeof(struct ddx_pin_page), true);
    if (!reader->page)
        return;
    reader->pin_fd = ddx_packet_take(packet, 0);
    /* Shows the writer that this reader lives, so that its pins count. */
    reader->hold_fd = ddx_memory_hold(reader->pin_fd);
    /* No other program may write to the page, although each writer of the item gets its file. */
    if (reader->hold_fd < 0 || ddx_memory_freeze(reader->pin_fd)) {
        if (reader->hold_fd >= 0)
            close(reader->hold_fd);
        reader->hold_fd = -1;
        munmap(reader->page, sizeof(struct ddx_pin_page));
        close(reader->pin_fd);
        reader->page = NULL;
        reader->pin_fd = -1;
        return;
    }
    /* Not the number in the control page now: frames written since the store admitted this reader are not yet seen. */
    ddx_reader_saw(reader, packet->message.sequence);
    DDX_PASS(ATTACH_PAGE);
}

void ddx_reader_end(struct ddx_reader_role *reader) {
    ddx_window_withdraw(reader);
    if (reader->page) {
        for (unsigned pin = 0; pin < DDX_PINS; pin++)
            ddx_ring_unpin(&reader->page->pin[pin]);
        munmap(reader->page, sizeof(struct ddx_pin_page));
        close(reader->pin_fd);
        if (reader->hold_fd >= 0)
            close(reader->hold_fd);
    }
    ddx_term_free(reader->coming);
    ddx_term_free(reader->term);
    ddx_slot_unmap(reader->window, reader->window_bytes);
    if (reader->page)
        DDX_PASS(ATTACH_ENDED);
}
