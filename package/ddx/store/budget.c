/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <string.h>

#include "budget.h"
#include "files.h"
#include "items.h"
#include "note.h"
#include "retired.h"

#define BOOK "DDX_STATS" /* see ddx_stats.h */
#define REQUEST 65536u   /* bytes of kept memory that one request may take */

uint64_t budget_used(struct store *store) {
    uint64_t sum = 0;

    retired_sweep(store);
    for (const struct item *item = store->items; item; item = item->next)
        sum += item_bytes(item) + retired_bytes(store, item);
    return sum + retired_bytes(store, NULL);
}

uint64_t budget_reserved(const struct store *store) {
    uint64_t sum = 0;

    for (const struct item *item = store->items; item; item = item->next)
        sum += item_reserved(item);
    return sum + retired_bytes(store, NULL);
}

/* Whether this account, NULL: any, pays for it. */
static bool is_paid_by(const struct item *item, const struct kept_account *account) {
    return !account || kept_account(item) == account || (item->epoch && kept_account(item->epoch) == account);
}

/*
 * The item that was written longest ago among those that nobody has open; a book only when nothing else is left: with
 * it goes what a dead program has lost, and nobody could tell any more.
 */
static struct item *least_wanted(const struct store *store, const struct item *except,
                                 const struct kept_account *account) {
    struct item *found = NULL;
    int64_t oldest = INT64_MAX;
    bool found_book = false;

    for (struct item *item = store->items; item; item = item->next) {
        struct ddx_ring_frame frame = {.time = 0};

        if (item->handles || item == except || !is_paid_by(item, account))
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

    for (const struct item *item = except->store->items; item; item = item->next)
        if (!item->handles && item != except)
            sum += item_reserved(item);
    return sum;
}

static void drop(struct item *victim) {
    epoch_retire(victim, victim->epoch);
    victim->epoch = NULL;
    item_drop_if_unused(victim);
    files_commit(); /* only then are its files closed, and do not count any more */
}

bool budget_allows(struct item *item, uint64_t reserved) {
    struct store *store = item->store;

    for (;;) {
        retired_sweep(store);
        uint64_t others = budget_reserved(store) - item_reserved(item);

        if (others + reserved <= store->settings->budget)
            return true;
        if (others - droppable(item) + reserved > store->settings->budget)
            return false; /* nothing is dropped in vain */
        struct item *victim = least_wanted(store, item, NULL);
        if (!victim)
            return false;
        note("%s: dropped, nobody has it open and its memory is needed for %s", victim->name, item->name);
        drop(victim);
    }
}

void budget_make_room(struct store *store, const struct process *process) {
    struct item *victim;

    while (process->account.bytes > KEPT_SHARE - REQUEST &&
           (victim = least_wanted(store, NULL, &process->account))) {
        note("%s: dropped, nobody has it open and %d needs memory for other names and types", victim->name,
             (int)process->pid);
        drop(victim);
    }
}
