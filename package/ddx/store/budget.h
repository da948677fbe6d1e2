/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The budget is a promise: what is reserved is never more than -m. An item reserves its memory and, since a new writer
 * needs files of its own while readers still look at the old ones, the same again for a change of writer.
 */
#ifndef STORE_BUDGET_H
#define STORE_BUDGET_H

#include "state.h"

uint64_t budget_used(struct store *store);
uint64_t budget_reserved(const struct store *store);
/* May this item's reservation become `reserved`? Drops items without a holder, oldest first, to free memory. */
bool budget_allows(struct item *item, uint64_t reserved);
/*
 * Before a process's next request: drop items that it has left, oldest first, while its share of checkpointed memory
 * is nearly used up.
 */
void budget_make_room(struct store *store, const struct process *process);

#endif
