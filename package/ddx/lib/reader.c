/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "roles.h"

#include <errno.h>
#include <string.h>
#include <time.h>

#include "handle.h"
#include "fault.h"
#include "futex.h"

#define AGAIN_NS 10000000    /* between requests to attach */
#define ATTEMPTS 5           /* to pin a frame that was overwritten or is not mapped yet, even without a timeout */
#define OVERTAKEN 10000      /* attempts when there is no earlier frame; only a malicious writer causes this many */
#define UNMAPPED_NS 10000000 /* within which the store announces an added slot */

int ddx_reader_ask(DDX_STORE_ITEM *item, unsigned frames) {
    struct ddx_message message;

    ddx_message_init(&message, DDX_ATTACH, item);
    message.frames = frames;
    int64_t deadline = ddx_time_now() + DDX_ANSWER_NS;
    int result;
    /* -EAGAIN: the store was restarted and the item's writer has not reported back yet. */
    while ((result = ddx_item_request(item, &message, NULL, DDX_ATTACHED)) == -EAGAIN && ddx_time_now() < deadline) {
        struct timespec step = {0, AGAIN_NS};

        nanosleep(&step, NULL);
    }
    return result == -EAGAIN ? -EBUSY : result;
}

DDX_COLD static int attach(DDX_STORE_ITEM *item) {
    int result = ddx_reader_ask(item, item->reader.keep);

    if (result)
        return result;
    if (item->reader.page)
        return 0;
    ddx_item_disconnect(item); /* else the store would count this handle as a reader */
    return -EMFILE;            /* the pin page came without its file: no free descriptor */
}

/*
 * How far the newest frame is ahead of `seen`. Only the low 23 bits are compared; since no reader sees an unpublished
 * frame, a large difference means that the reader slept for long, not that it is ahead.
 */
DDX_HOT static int32_t ahead(uint32_t latest, uint64_t seen) {
    return (int32_t)((DDX_LATEST_SEQUENCE(latest) - (uint32_t)seen) & 0x7fffffu);
}

bool ddx_reader_wake(const DDX_STORE_ITEM *item) {
    const struct ddx_reader_role *reader = &item->reader;

    if (!reader->waiting || reader->waits_since == atomic_load(&item->changed))
        return false;
    if (reader->term)
        ddx_futex_wake(&reader->term->control->latest);
    return true;
}

/* Unlocked, so that the keeper can receive messages; `waiting` prevents it from unmapping the word on a new epoch. */
DDX_HOT static void sleep_on(DDX_STORE_ITEM *item, const ddx_word *word, uint32_t value, uint32_t changed,
                             int64_t deadline) {
    item->reader.waiting = true;
    item->reader.waits_since = changed;
    ddx_lock_give(&item->lock);
    ddx_futex_wait(word, value, word != &item->changed, deadline);
    ddx_lock_take(&item->lock);
    item->reader.waiting = false;
}

/* GONE: the frame was overwritten, or its slot is not mapped yet. */
enum wanted { PINNED, NOT_THERE, GONE };

/* The frame is in an added slot that is not mapped yet: wait for the slot's announcement. */
DDX_COLD static void await_slot(DDX_STORE_ITEM *item, unsigned slot) {
    int64_t until = ddx_time_now() + UNMAPPED_NS;
    uint32_t changed = atomic_load(&item->changed);

    ddx_item_service(item);
    if (item->reader.term->base[slot])
        return;
    DDX_PASS(READER_UNMAPPED);
    sleep_on(item, &item->changed, changed, changed, until);
}

/* Try to pin the frame that `tail` selects. */
DDX_HOT static enum wanted pin_wanted(DDX_STORE_ITEM *item, unsigned pin, int tail, uint32_t latest,
                                      struct ddx_ring_frame *frame) {
    struct ddx_reader_role *reader = &item->reader;
    struct ddx_control *control = reader->term->control;
    uint32_t generation;
    unsigned slot;

    if (tail == DDX_IN_ORDER)
        slot = ddx_ring_next(control, reader->seen, &generation);
    else if (tail == DDX_CURRENT || ahead(latest, reader->seen) >= tail)
        slot = DDX_LATEST_SLOT(latest);
    else
        slot = DDX_NO_SLOT;
    if (slot >= DDX_SLOTS_MAX)
        return NOT_THERE;
    if (tail != DDX_IN_ORDER)
        generation = ddx_ring_published(control, latest);
    DDX_PASS(READER_CHOSEN);
    if (!reader->term->base[slot]) {
        await_slot(item, slot);
        return GONE;
    }
    return ddx_ring_pin(control, &reader->page->pin[pin], slot, generation, frame) ? GONE : PINNED;
}

DDX_HOT static int64_t deadline_of(double timeout) {
    if (timeout < 0)
        return DDX_FOREVER;
    return timeout > 1e9 ? DDX_FOREVER : ddx_time_now() + (int64_t)(timeout * 1e9);
}

DDX_HOT static void count_missed(struct ddx_reader_role *reader, uint64_t sequence, uint64_t *missed) {
    *missed = sequence > reader->seen + 1 ? sequence - reader->seen - 1 : 0;
    ddx_reader_saw(reader, sequence);
    if (!*missed)
        return;
    reader->missed += *missed;
    atomic_store_explicit(&reader->page->missed_low, (uint32_t)reader->missed, memory_order_relaxed);
    atomic_store_explicit(&reader->page->missed_high, (uint32_t)(reader->missed >> 32), memory_order_relaxed);
}

/* A handle that reads while a frame is in its window holds two frames, so it needs memory for a second one. */
DDX_COLD static int take_both(DDX_STORE_ITEM *item) {
    int result = ddx_reader_ask(item, 1);

    item->reader.both = !result;
    if (!result)
        DDX_PASS(ATTACH_BOTH);
    return result;
}

DDX_HOT int ddx_reader_take(DDX_STORE_ITEM *item, unsigned pin, struct ddx_ring_frame *frame, uint64_t *missed,
                            double timeout, int tail) {
    struct ddx_reader_role *reader = &item->reader;
    int64_t deadline = 0; /* known when there is something to wait for */
    bool asked = false;
    int attempts = ATTEMPTS, overtaken = 0, result;

    if (tail < DDX_IN_ORDER)
        return -EINVAL;
    reader->in_order = tail == DDX_IN_ORDER;
    if (pin == DDX_PIN_READ && reader->held >= 0)
        return -EBUSY;
    if (!reader->page && (result = attach(item)))
        return result;
    if (atomic_load_explicit(&reader->page->pin[!pin], memory_order_relaxed) && !reader->both &&
        (result = take_both(item)))
        return result;
    for (;;) {
        uint32_t changed = atomic_load(&item->changed), latest = 0;

        if (reader->coming)
            ddx_reader_follow(reader);
        enum wanted wanted = NOT_THERE;
        if (reader->term) {
            ddx_ring_newest(reader->term->control, &latest);
            if (tail == DDX_CURRENT && !asked) {
                asked = true; /* another writer may have begun, unnoticed by the keeper yet; costs 0.5 us */
                ddx_item_service(item);
                continue;
            }
            wanted = pin_wanted(item, pin, tail, latest, frame);
        }
        if (wanted == PINNED) {
            count_missed(reader, frame->sequence, missed);
            DDX_PASS(READER_COUNTED);
            return 0;
        }
        if (wanted == GONE && pin == DDX_PIN_DIRECT && !ddx_window_keep(reader) && overtaken++ < OVERTAKEN)
            continue; /* the window's frame was overwritten, so it needs another one */
        /* The value exists, but its slot is not mapped: that is not a timeout, even for a reader that does not wait. */
        if (wanted == GONE && attempts-- > 0)
            continue;
        if (!deadline)
            deadline = deadline_of(timeout);
        else if (ddx_time_now() >= deadline)
            timeout = 0;
        if (timeout == 0) {
            if (asked)
                return -ETIMEDOUT;
            /* The keeper may not have read the message yet; even a reader that does not wait must see the frame. */
            asked = true;
            ddx_item_service(item);
            continue;
        }
        if (wanted == GONE)
            continue;
        if (pin == DDX_PIN_DIRECT)
            ddx_window_prepare(reader);
        DDX_PASS(READER_WAITS);
        if (reader->term)
            sleep_on(item, &reader->term->control->latest, latest, changed, deadline);
        else
            sleep_on(item, &item->changed, changed, changed, deadline);
    }
}

/* ---- Copies and held frames ---- */

/* Reading: copy a frame or hand it out. */

DDX_HOT int ddx_store_acquire(DDX_STORE_ITEM *item, struct ddx_frame *frame, double timeout, int tail) {
    struct ddx_ring_frame found;
    uint64_t missed;

    if (!item || !frame)
        return -EINVAL;
    ddx_lock_take(&item->lock);
    int result = ddx_reader_take(item, DDX_PIN_READ, &found, &missed, timeout, tail);
    if (!result) {
        item->reader.held = (int)found.slot;
        *frame = (struct ddx_frame){item->reader.term->base[found.slot], found.time, found.sequence, missed};
    }
    ddx_lock_give(&item->lock);
    return result;
}

DDX_HOT int ddx_store_release(DDX_STORE_ITEM *item) {
    if (!item)
        return -EINVAL;
    ddx_lock_take(&item->lock);
    int result = item->reader.held < 0 ? -EINVAL : 0;
    if (!result) {
        ddx_ring_unpin(&item->reader.page->pin[DDX_PIN_READ]);
        item->reader.held = -1;
        DDX_PASS(READER_RELEASED);
    }
    ddx_lock_give(&item->lock);
    return result;
}

DDX_HOT int ddx_store_read(DDX_STORE_ITEM *item, void *data, DDX_TIME *ts, double timeout, int tail) {
    struct ddx_ring_frame found;
    uint64_t missed;

    if (!item || !data)
        return -EINVAL;
    ddx_lock_take(&item->lock);
    struct ddx_reader_role *reader = &item->reader;
    int result = !reader->term || reader->term->uncopied ? ddx_item_copies(item) : 0;
    if (!result)
        result = ddx_reader_take(item, DDX_PIN_READ, &found, &missed, timeout, tail);
    if (!result) {
        const struct ddx_term *term = reader->term;
        const char *base = term->base[found.slot];

        result = term->uncopied;
        for (unsigned i = 0; i < term->span_count && !result; i++)
            memcpy((char *)data + term->spans[i].own, base + term->spans[i].item, (size_t)term->spans[i].bytes);
        if (!result && ts)
            *ts = found.time;
        DDX_PASS(READER_COPIED);
        ddx_ring_unpin(&reader->page->pin[DDX_PIN_READ]);
    }
    ddx_lock_give(&item->lock);
    return result;
}

int ddx_store_keep(DDX_STORE_ITEM *item, unsigned frames) {
    if (!item || frames < 1 || frames > DDX_READERS_MAX)
        return -EINVAL;
    ddx_lock_take(&item->lock);
    struct ddx_reader_role *reader = &item->reader;
    int result = 0;
    if (reader->page) /* only the additional frames */
        result = frames > reader->keep ? ddx_reader_ask(item, frames - reader->keep) : 0;
    if (!result && (!reader->page || frames > reader->keep))
        reader->keep = frames;
    ddx_lock_give(&item->lock);
    return result;
}

unsigned ddx_store_kept(const DDX_STORE_ITEM *item) {
    return item ? item->reader.keep : 0;
}

uint64_t ddx_store_seen(const DDX_STORE_ITEM *item) {
    DDX_STORE_ITEM *handle = (DDX_STORE_ITEM *)(uintptr_t)item;

    if (!handle)
        return 0;
    ddx_lock_take(&handle->lock);
    uint64_t seen = handle->reader.seen;
    ddx_lock_give(&handle->lock);
    return seen;
}

uint64_t ddx_store_missed(const DDX_STORE_ITEM *item) {
    return item ? item->reader.missed : 0;
}

/* ---- The stable pointer ---- */

static int make_window(DDX_STORE_ITEM *item) {
    return ddx_window_make(&item->reader, item->own ? item->own : item->layout);
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
        result = ddx_window_show(&item->reader, found.slot);
        item->reader.shown_generation = (uint32_t)found.sequence << 1; /* of ddx_ring_publish() */
        if (result || item->reader.shown < 0)
            ddx_ring_unpin(&item->reader.page->pin[DDX_PIN_DIRECT]);
        if (!result && ts)
            *ts = found.time;
    }
    if (result)
        ddx_window_restore(&item->reader);
    ddx_lock_give(&item->lock);
    return result;
}
