/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Reading: copy a frame or hand it out. */
#include <errno.h>
#include <string.h>

#include "fault.h"
#include "reader_take.h"

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
