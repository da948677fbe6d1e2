/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Reading values from the store into the queue: one item after the other, a few microseconds each. */
#include "read.h"

#include <errno.h>
#include <inttypes.h>
#include <mcap.h>
#include <stdlib.h>
#include <string.h>

#define BATCH 256 /* values of one item before the next item's turn */

/* Set the channel for the item's current layout. 0 or -errno. */
static int choose_channel(struct item *item) {
    uint32_t layout = ddx_store_layout(item->handle);

    if (item->channel && layout == item->layout)
        return 0;
    struct form *form;
    int error = form_of_item(item->handle, &form);
    if (error)
        return error;
    struct channel *channel = item->channels;
    while (channel && !form_same(channel->form, form))
        channel = channel->next;
    if (channel) {
        form_free(form);
    } else {
        channel = calloc(1, sizeof *channel);
        if (!channel) {
            form_free(form);
            return -ENOMEM;
        }
        channel->form = form;
        channel->item = item;
        channel->next = item->channels;
        item->channels = channel;
    }
    item->channel = channel;
    item->layout = layout;
    return 0;
}

static void count_lost(struct logger *logger, struct item *item, unsigned reason, uint64_t values) {
    atomic_fetch_add(&item->lost[reason], values);
    ddx_stats_lost(logger->book, reason, values);
}

/* Count missed values: with a rate as skipped, else as lost. */
static void count_missed(struct logger *logger, struct item *item, uint64_t missed) {
    if (!missed)
        return;
    if (item->rule->period) {
        atomic_fetch_add(&item->skipped, missed);
        ddx_stats_skipped(logger->book, missed);
        return;
    }
    atomic_fetch_add(&item->in, missed);
    ddx_stats_in(logger->book, missed, 0);
    count_lost(logger, item, LOST_STORE, missed);
}

static void take_value(struct logger *logger, struct item *item, const struct ddx_frame *frame) {
    atomic_fetch_add(&item->in, 1);
    ddx_stats_in(logger->book, 1, 0);
    item->sequence = frame->sequence;
    atomic_store(&item->consumed, frame->sequence);
    int error = choose_channel(item);
    if (error) {
        if (!item->refused)
            say("%s: its values cannot be logged: %s", item->name, ddx_error_text(error));
        item->refused = true;
        count_lost(logger, item, LOST_STORE, 1);
        return;
    }
    const struct form *form = item->channel->form;
    bool large = form->message_size > MCAP_MESSAGE_MAX;
    struct queue_entry *entry = large ? NULL : queue_place(&logger->queue, form->message_size);
    if (!entry) {
        if (!item->refused)
            say("losing values of %s from %" PRIu64 " on: %s", item->name, frame->sequence,
                large ? "one is larger than what a log can hold (63 MiB)"
                : form->message_size > logger->queue.size ? "one is larger than the queue (queue SIZE in logger.conf)"
                                                        : "the queue is full, the disk is too slow");
        item->refused = true;
        count_lost(logger, item, LOST_QUEUE, 1);
        return;
    }
    item->refused = false;
    entry->item = item;
    entry->channel = item->channel;
    entry->sequence = frame->sequence;
    entry->time = frame->time;
    int64_t now = ddx_time_now();
    entry->logged = frame->time < logger->begin || frame->time > now ? now : frame->time;
    form_pack(form, frame->data, entry->data);
    queue_put(&logger->queue);
}

void item_begin(struct logger *logger, struct item *item) {
    struct ddx_frame *first = &item->first;

    if (first->sequence) {
        bool again = item->known && first->sequence == item->sequence;

        if (item->known && first->sequence > item->sequence)
            count_missed(logger, item, first->sequence - item->sequence - 1);
        else if (!again && (item->known || item->awaited)) /* numbering started again, or the item was awaited */
            count_missed(logger, item, first->sequence - 1);
        if (!again)
            take_value(logger, item, first);
        ddx_store_release(item->handle);
    }
    item->known = true;
    item->due = ddx_time_now() + item->rule->period;
    atomic_store(&item->state, ITEM_READ);
}

void item_leave(struct item *item) {
    ddx_store_done_item(item->handle);
    item->handle = NULL;
    item->channel = NULL;
    atomic_store(&item->state, ITEM_ABSENT);
}

/* Whether the rate allows a value now. */
static bool is_due(struct item *item) {
    int64_t now = ddx_time_now();

    if (now < item->due)
        return false;
    item->due += item->rule->period; /* a late read does not lower the rate */
    if (item->due <= now)
        item->due = now + item->rule->period;
    return true;
}

bool item_take(struct logger *logger, struct item *item) {
    unsigned keep = atomic_load(&item->keep);

    if (keep > item->kept) {
        ddx_store_keep(item->handle, keep); /* without room in the store, the number remains as it is */
        item->kept = keep;
    }
    int64_t due = item->due;
    if (item->rule->period && !is_due(item))
        return true;
    int tail = item->rule->period ? DDX_NEXT : DDX_IN_ORDER, error = 0;
    for (int i = 0; i < (item->rule->period ? 1 : BATCH); i++) {
        struct ddx_frame frame;

        error = ddx_store_acquire(item->handle, &frame, 0, tail);
        if (error)
            break;
        count_missed(logger, item, frame.missed);
        take_value(logger, item, &frame);
        ddx_store_release(item->handle);
    }
    if (error && item->rule->period)
        item->due = due; /* there was no value: the next one is due at once */
    if (error && error != -ETIMEDOUT) {
        say("%s: %s; it will be tried again", item->name, ddx_error_text(error));
        return false;
    }
    return true;
}
