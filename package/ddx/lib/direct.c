/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * The paper's stable pointer over a ring of slots: the pages of the pinned slot are moved into a window whose address
 * never changes, and home again when the next frame comes. Moving page tables costs ten or twenty microseconds,
 * copying or mapping anew hundreds. A reader that waits moves them beforehand, since it is known which slot is the
 * writer's next; the frame is looked at only when it is pinned, as ever. Should another one come, they are moved then.
 */
#include <errno.h>
#include <string.h>
#include <sys/mman.h>

#include "fault.h"
#include "item.h"

static int make_window(DDX_STORE_ITEM *item) {
    struct ddx_reader_role *reader = &item->reader;
    const struct ddx_layout *shown = item->own ? item->own : item->layout;

    reader->window_bytes = ddx_page_round(shown->size);
    reader->window = ddx_slot_reserve(reader->window_bytes);
    return reader->window ? 0 : -errno;
}

void *ddx_store_var_pointer(DDX_STORE_ITEM *item) {
    int result = -EINVAL;

    if (item) {
        ddx_lock_take(&item->lock);
        result = item->reader.window ? 0 : make_window(item);
        ddx_lock_give(&item->lock);
    }
    if (!result)
        return item->reader.window;
    errno = -result;
    return NULL;
}

/* The window's pages back into the slot that they belong to. */
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

void ddx_direct_prepare(struct ddx_reader_role *reader) {
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

/* No frame came: the former one is shown again. */
DDX_COLD static void restore(struct ddx_reader_role *reader) {
    if (!reader->shown_term || reader->placed < 0 || reader->placed == reader->shown)
        return;
    go_home(reader);
    place(reader, reader->shown_term, (unsigned)reader->shown);
    DDX_PASS(DIRECT_RESTORED);
}

DDX_COLD bool ddx_direct_keep(struct ddx_reader_role *reader) {
    ddx_word *pin = &reader->page->pin[DDX_PIN_DIRECT];
    struct ddx_ring_frame frame;

    if (reader->shown < 0 || !reader->shown_term || reader->shown_term != reader->term ||
        atomic_load_explicit(pin, memory_order_relaxed))
        return true;
    return !ddx_ring_pin(reader->term->control, pin, (unsigned)reader->shown, reader->shown_generation, &frame);
}

void ddx_direct_withdraw(struct ddx_reader_role *reader) {
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

/* Is the caller's struct the item's, but for a shorter end? Then its pages can be shown as they are. */
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

DDX_HOT static int show(DDX_STORE_ITEM *item, unsigned slot) {
    struct ddx_reader_role *reader = &item->reader;
    struct ddx_term *term = reader->term;

    if (term->mismatch)
        return term->mismatch;
    for (unsigned i = 0; i < term->span_count; i++)
        if (term->spans[i].own + term->spans[i].bytes > reader->window_bytes)
            return -EMSGSIZE; /* grew since the window was made */
    if (term == reader->shown_term && reader->placed == (int)slot) {
        reader->shown = (int)slot;
        DDX_PASS(DIRECT_SHOWN);
        return 0;
    }
    ddx_direct_withdraw(reader);
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

DDX_HOT int ddx_store_read_direct(DDX_STORE_ITEM *item, DDX_TIME *ts, double timeout, int tail) {
    struct ddx_ring_frame found;
    uint64_t missed;

    if (!item)
        return -EINVAL;
    ddx_lock_take(&item->lock);
    int result = item->reader.window ? 0 : make_window(item);
    if (!result)
        result = ddx_reader_take(item, DDX_PIN_DIRECT, &found, &missed, timeout, tail);
    if (!result) {
        DDX_PASS(DIRECT_TAKEN);
        result = show(item, found.slot);
        item->reader.shown_generation = (uint32_t)found.sequence << 1; /* of ddx_ring_publish() */
        if (result || item->reader.shown < 0)
            ddx_ring_unpin(&item->reader.page->pin[DDX_PIN_DIRECT]);
        if (!result && ts)
            *ts = found.time;
    }
    if (result)
        restore(&item->reader);
    ddx_lock_give(&item->lock);
    return result;
}
