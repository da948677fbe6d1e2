/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The budget is a promise: what is reserved is never more than -m. An item reserves its memory and, since a new writer
 * needs files of its own while readers still look at the old ones, the same again for a change of writer.
 */
#include <string.h>

#include "server.h"

#define BOOK "DDX_STATS" /* see ddx_stats.h */

uint64_t budget_used(void) {
    uint64_t sum = 0;

    retired_sweep();
    for (const struct item *item = store->items; item; item = item->next)
        sum += item_bytes(item) + retired_bytes(item);
    return sum + retired_bytes(NULL);
}

uint64_t budget_reserved(void) {
    uint64_t sum = 0;

    for (const struct item *item = store->items; item; item = item->next)
        sum += item_reserved(item);
    return sum + retired_bytes(NULL);
}

/*
 * The item that was written longest ago among those that nobody has open; a book only when nothing else is left: with
 * it goes what a dead program has lost, and nobody could tell any more.
 */
static struct item *least_wanted(const struct item *except) {
    struct item *found = NULL;
    int64_t oldest = INT64_MAX;
    bool found_book = false;

    for (struct item *item = store->items; item; item = item->next) {
        struct ddx_ring_frame frame = {.time = 0};

        if (item->handles || item == except)
            continue;
        if (item->epoch)
            ddx_ring_peek(item->epoch->control, &frame);
        bool book = !strcmp(item->type, BOOK);
        if (found && book != found_book ? found_book : frame.time < oldest) {
            oldest = frame.time;
            found = item;
            found_book = book;
        }
    }
    return found;
}

/* What could be had if all items were dropped that nobody has open. */
static uint64_t droppable(const struct item *except) {
    uint64_t sum = 0;

    for (const struct item *item = store->items; item; item = item->next)
        if (!item->handles && item != except)
            sum += item_reserved(item);
    return sum;
}

bool budget_allows(struct item *item, uint64_t reserved) {
    for (;;) {
        retired_sweep();
        uint64_t others = budget_reserved() - item_reserved(item);

        if (others + reserved <= settings.budget)
            return true;
        clients_reap();
        retired_sweep();
        if (budget_reserved() - item_reserved(item) < others)
            continue;
        if (others - droppable(item) + reserved > settings.budget)
            return false; /* nothing is dropped in vain */
        struct item *victim = least_wanted(item);
        if (!victim)
            return false;
        note("%s: dropped, nobody has it open and its memory is needed for %s", victim->name, item->name);
        epoch_retire(victim, victim->epoch);
        victim->epoch = NULL;
        item_drop_if_unused(victim);
        store_commit(); /* only then are its files closed, and do not count any more */
    }
}
