/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "roles.h"

#include <errno.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "fault.h"
#include "handle.h"

/* ---- The window of the stable pointer ---- */

/*
 * The paper's stable pointer over a ring of slots: the pages of the pinned slot are moved into a window whose address
 * never changes, and back when the next frame comes. Moving page tables takes 10 to 20 us; copying, or a new mapping,
 * hundreds. A waiting reader moves the pages of the writer's probable next slot in advance; it reads the frame only
 * once the slot is pinned. If the frame comes in another slot, the pages are moved then.
 */

int ddx_window_make(struct ddx_reader_role *reader, const struct ddx_layout *shown) {
    reader->window_bytes = ddx_page_round(shown->size);
    reader->window = ddx_slot_reserve(reader->window_bytes);
    return reader->window ? 0 : -errno;
}

/* Move the window's pages back into their slot. */
static void go_home(struct ddx_reader_role *reader) {
    const struct ddx_term *term = reader->shown_term;

    if (reader->placed >= 0)
        ddx_slot_move(reader->window, term->base[reader->placed], &term->runs, reader->window_bytes,
                      term->fd[reader->placed]);
    reader->placed = -1;
}

static int place(struct ddx_reader_role *reader, const struct ddx_term *term, unsigned slot) {
    int result = ddx_slot_move(term->base[slot], reader->window, &term->runs, reader->window_bytes, term->fd[slot]);

    if (!result)
        reader->placed = (int)slot;
    return result;
}

void ddx_window_prepare(struct ddx_reader_role *reader) {
    const struct ddx_term *term = reader->shown_term;
    unsigned coming;

    if (!term)
        return;
    coming = term == reader->term ? ddx_ring_coming(term->control, term->base, (unsigned)reader->shown) : DDX_NO_SLOT;
    if (reader->placed == (coming == DDX_NO_SLOT ? -1 : (int)coming))
        return;
    go_home(reader);
    if (coming != DDX_NO_SLOT)
        place(reader, term, coming);
    DDX_PASS(DIRECT_PREPARED);
}

DDX_COLD void ddx_window_restore(struct ddx_reader_role *reader) {
    if (!reader->shown_term || reader->placed < 0 || reader->placed == reader->shown)
        return;
    go_home(reader);
    place(reader, reader->shown_term, (unsigned)reader->shown);
    DDX_PASS(DIRECT_RESTORED);
}

DDX_COLD bool ddx_window_keep(struct ddx_reader_role *reader) {
    ddx_word *pin = &reader->page->pin[DDX_PIN_DIRECT];
    struct ddx_ring_frame frame;

    if (reader->shown < 0 || !reader->shown_term || reader->shown_term != reader->term ||
        atomic_load_explicit(pin, memory_order_relaxed))
        return true;
    return !ddx_ring_pin(reader->term->control, pin, (unsigned)reader->shown, reader->shown_generation, &frame);
}

/* The content of the window is undefined from now on. */
static void ddx_window_withdraw(struct ddx_reader_role *reader) {
    struct ddx_term *term = reader->shown_term;

    if (!term)
        return;
    go_home(reader);
    DDX_PASS(DIRECT_WITHDRAWN);
    if (term != reader->term)
        ddx_term_free(term); /* its epoch has ended, and this was its last frame in use */
    reader->shown_term = NULL;
    reader->shown = -1;
}

/* Whether all fields have the same offsets in the caller's struct, so that the slot's pages can be shown directly. */
DDX_HOT static bool same_places(const struct ddx_term *term) {
    for (unsigned i = 0; i < term->span_count; i++)
        if (term->spans[i].item != term->spans[i].own)
            return false;
    return true;
}

static int show_copy(struct ddx_reader_role *reader, const struct ddx_term *term, unsigned slot) {
    if (!reader->window_copied && mmap(reader->window, (size_t)reader->window_bytes, PROT_READ | PROT_WRITE,
                                       MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED, -1, 0) == MAP_FAILED)
        return -errno;
    reader->window_copied = true;
    for (unsigned i = 0; i < term->span_count; i++)
        memcpy((char *)reader->window + term->spans[i].own, (char *)term->base[slot] + term->spans[i].item,
               (size_t)term->spans[i].bytes);
    return 0;
}

DDX_HOT int ddx_window_show(struct ddx_reader_role *reader, unsigned slot) {
    struct ddx_term *term = reader->term;

    if (term->mismatch)
        return term->mismatch;
    for (unsigned i = 0; i < term->span_count; i++)
        if (term->spans[i].own + term->spans[i].bytes > reader->window_bytes)
            return -EMSGSIZE; /* the item has grown since the window was made */
    if (term == reader->shown_term && reader->placed == (int)slot) {
        reader->shown = (int)slot;
        DDX_PASS(DIRECT_SHOWN);
        return 0;
    }
    ddx_window_withdraw(reader);
    if (!same_places(term))
        return show_copy(reader, term, slot);
    int result = place(reader, term, slot);
    if (result)
        return result;
    reader->window_copied = false;
    reader->shown_term = term;
    reader->shown = (int)slot;
    DDX_PASS(DIRECT_SHOWN);
    return 0;
}

/* ---- Reader ---- */

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
    term->begins_again = packet->message.sequence < reader->seen || (reader->coming && reader->coming->begins_again);
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
