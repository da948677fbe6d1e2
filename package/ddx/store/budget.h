/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Limits of the programs: the share of each process, and the budget: reservations never exceed -m. An item reserves its
 * memory twice, since after a change of writer the new writer needs files of its own while readers still use the old
 * ones.
 */
#ifndef STORE_BUDGET_H
#define STORE_BUDGET_H

#include "state.h"

/* ---- Client processes (by pid), and the share of each, over all of its connections together ---- */

/* Add a connection. NULL: no memory. */
struct process *process_join(struct store *store, int32_t pid);

/* Remove a connection. A process without connections and checkpointed memory is dropped. */
void process_leave(struct process *process);
void processes_sweep(struct store *store);

/* Log once that the process has reached its share of checkpointed memory, if it asked for more. */
void process_report(struct process *process);

/* How many more of its messages may be handled in this turn of the worker; count a handled one. */
unsigned process_share(const struct process *process, uint32_t turn);
void process_heard(struct process *process, uint32_t turn);

/* ---- The budget ---- */

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
