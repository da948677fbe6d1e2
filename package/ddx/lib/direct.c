/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Reading through the stable pointer: the public calls; the window itself is in window.c. */
#include <errno.h>

#include "fault.h"
#include "reader_take.h"
#include "window.h"

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
