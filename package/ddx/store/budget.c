/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <limits.h>
#include <stdio.h>

#include "budget.h"
#include "items.h"
#include "leftover.h"
#include "retired.h"

#define REQUEST 65536u /* bytes of checkpointed memory that one request may take */

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

bool budget_allows(struct item *item, uint64_t reserved) {
    struct store *store = item->store;

    for (;;) {
        retired_sweep(store);
        uint64_t others = budget_reserved(store) - item_reserved(item);

        if (others + reserved <= store->settings->budget)
            return true;
        if (others - leftover_bytes(store, item) + reserved > store->settings->budget)
            return false; /* even dropping all of them would not be enough */
        struct item *victim = leftover_first(store, item, INT_MAX, NULL);
        if (!victim)
            return false;
        leftover_drop(victim, "memory is", item->name);
    }
}

void budget_make_room(struct store *store, const struct process *process) {
    char whom[32];
    struct item *victim;

    snprintf(whom, sizeof whom, "process %d", (int)process->pid);
    while (process->account.bytes > CHECKPOINT_SHARE - REQUEST &&
           (victim = leftover_first(store, NULL, INT_MAX, &process->account)))
        leftover_drop(victim, "share of the store's memory is", whom);
}
