/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The budget: reservations never exceed -m. An item reserves its memory twice, since after a change of writer the new
 * writer needs files of its own while readers still use the old ones.
 */
#ifndef STORE_BUDGET_H
#define STORE_BUDGET_H

#include "state.h"

/*
 * Free `count` descriptors for the item by dropping other items. False, and no item is dropped, if that would not free
 * enough.
 */
bool descriptors_for_item(struct item *item, unsigned count);

/* The same for one descriptor with a number below `number`. */
bool descriptors_below(struct store *store, int number);

uint64_t budget_used(struct store *store);
uint64_t budget_reserved(const struct store *store);
/* Whether this item's reservation may become `reserved`. Drops items without a holder, oldest first, to free memory. */
bool budget_allows(struct item *item, uint64_t reserved);
/*
 * Before a process's next request: while its share of checkpointed memory is nearly used up, drop items that the
 * process has left, oldest first.
 */
void budget_make_room(struct store *store, const struct process *process);

#endif
