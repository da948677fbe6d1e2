/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Writing: claim the item once, then loan, fill, publish. */
#include "roles.h"

#include <errno.h>
#include <poll.h>
#include <string.h>

#include "fault.h"
#include "futex.h"
#include "handle.h"

#define REFUSAL_MS 5 /* to wait for the store to refuse a reader whose pins cannot be checked */

int ddx_writer_claim(DDX_STORE_ITEM *item) {
    struct ddx_message message;

    if (item->writer.superseded)
        return -EEXIST;
    if (item->writer.term)
        return 0;
    if (!*item->type)
        return -ENOENT; /* awaited: its type is unknown */
    ddx_message_init(&message, DDX_CLAIM, item);
    int result = ddx_item_request(item, &message, item->layout, DDX_DONE);
    if (result) {
        /* Drop files that arrived before the store died: readers do not know them, so they are useless. */
        ddx_writer_end(&item->writer);
        return item->lost_files ? -EMFILE : result;
    }
    DDX_PASS(CLAIM_GRANTED);
    return item->writer.term && item->writer.ring.slot_count >= 2 ? 0 : -EMFILE;
}

DDX_HOT static int choose(DDX_STORE_ITEM *item, unsigned *slot) {
    struct ddx_writer_role *writer = &item->writer;
    int result;

    if (writer->unseen_count) { /* the store refuses it at once, unless this program was stopped for long */
        struct pollfd wait = {.fd = item->socket, .events = POLLIN};

        poll(&wait, 1, REFUSAL_MS);
        ddx_item_service(item);
    }
    while ((result = writer->unseen_count ? -EMFILE : ddx_ring_choose(&writer->ring, slot)) != 0) {
        uint32_t version = atomic_load(&writer->notice->version);
        unsigned slots = writer->ring.slot_count;

        if (result == -EMFILE) {
            writer->given_up++;
            break;
        }
        if (result == -ENOBUFS) {
            /* There may be added slots in unread messages, and dead readers that were not reported. */
            ddx_item_service(item);
            if (ddx_writer_forget(writer, true) || writer->ring.slot_count > slots)
                continue;
            writer->given_up++;
            break;
        }
        /* The store sent the message before it changed the notice, so this does not wait. */
        if (ddx_item_service(item))
            /* The store has died: then the new reader was not admitted. */
            writer->ring.notice_seen = version;
    }
    return result;
}

DDX_HOT int ddx_store_loan(DDX_STORE_ITEM *item, void **data) {
    unsigned slot;

    if (!item || !data)
        return -EINVAL;
    ddx_lock_take(&item->lock);
    int result = ddx_writer_claim(item);
    if (!result && item->writer.loaned >= 0)
        result = -EBUSY;
    if (!result)
        result = choose(item, &slot);
    if (!result) {
        item->writer.loaned = (int)slot;
        *data = item->writer.term->base[slot];
    }
    ddx_lock_give(&item->lock);
    return result;
}

DDX_HOT int ddx_store_publish(DDX_STORE_ITEM *item, const DDX_TIME *ts) {
    if (!item)
        return -EINVAL;
    ddx_lock_take(&item->lock);
    struct ddx_writer_role *writer = &item->writer;
    int result = writer->loaned < 0 ? -EINVAL : 0;
    if (!result && writer->superseded) {
        ddx_ring_cancel(&writer->ring, (unsigned)writer->loaned);
        writer->loaned = -1;
        result = -EEXIST;
    }
    if (!result) {
        ddx_ring_publish(&writer->ring, (unsigned)writer->loaned, ts ? *ts : ddx_time_now());
        writer->loaned = -1;
        ddx_futex_wake(&writer->term->control->latest);
        DDX_PASS(WRITER_WOKE);
    }
    ddx_lock_give(&item->lock);
    return result;
}

int ddx_store_cancel(DDX_STORE_ITEM *item) {
    if (!item)
        return -EINVAL;
    ddx_lock_take(&item->lock);
    struct ddx_writer_role *writer = &item->writer;
    int result = writer->loaned < 0 ? -EINVAL : 0;
    if (!result) {
        ddx_ring_cancel(&writer->ring, (unsigned)writer->loaned);
        writer->loaned = -1;
    }
    ddx_lock_give(&item->lock);
    return result;
}

DDX_COLD static int may_copy(DDX_STORE_ITEM *item) {
    ddx_lock_take(&item->lock);
    int result = ddx_item_copies(item);
    ddx_lock_give(&item->lock);
    return result;
}

DDX_HOT int ddx_store_write(DDX_STORE_ITEM *item, const void *data, const DDX_TIME *ts) {
    void *frame;

    if (!item || !data)
        return -EINVAL;
    /* Before the first write: a handle that cannot write must not become the item's writer. */
    int result = item->writer.term ? 0 : may_copy(item);
    if (!result)
        result = ddx_store_loan(item, &frame);
    if (result)
        return result;
    const struct ddx_term *term = item->writer.term;
    if (term->uncopied) {
        ddx_store_cancel(item);
        return term->uncopied;
    }
    for (unsigned i = 0; i < term->span_count; i++)
        memcpy((char *)frame + term->spans[i].item, (const char *)data + term->spans[i].own,
               (size_t)term->spans[i].bytes);
    return ddx_store_publish(item, ts);
}

uint64_t ddx_store_lost(const DDX_STORE_ITEM *item) {
    return item ? item->writer.lost : 0;
}

uint64_t ddx_store_written(const DDX_STORE_ITEM *item) {
    return item && item->writer.term ? item->writer.ring.sequence : 0;
}

uint64_t ddx_store_short(const DDX_STORE_ITEM *item) {
    return item ? item->writer.given_up : 0;
}

int ddx_store_readers(const DDX_STORE_ITEM *item) {
    DDX_STORE_ITEM *handle = (DDX_STORE_ITEM *)(uintptr_t)item;
    int count = -EINVAL;

    if (!handle)
        return count;
    ddx_lock_take(&handle->lock);
    if (handle->writer.notice) {
        count = (int)atomic_load(&handle->writer.notice->readers);
        /* A caller that starts writing because readers exist must see their slots first. */
        ddx_item_service(handle);
    }
    ddx_lock_give(&handle->lock);
    return count;
}

int ddx_store_outruns(const DDX_STORE_ITEM *item) {
    DDX_STORE_ITEM *handle = (DDX_STORE_ITEM *)(uintptr_t)item;
    int result = -EINVAL;

    if (!handle)
        return result;
    ddx_lock_take(&handle->lock);
    if (handle->writer.term) {
        ddx_item_service(handle);
        result = handle->writer.loaned >= 0 ? -EBUSY : ddx_ring_outruns(&handle->writer.ring);
    }
    ddx_lock_give(&handle->lock);
    return result;
}
