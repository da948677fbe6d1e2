/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "window.h"

#include <errno.h>
#include <string.h>
#include <sys/mman.h>

#include "fault.h"
#include "term.h"

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

void ddx_window_withdraw(struct ddx_reader_role *reader) {
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
