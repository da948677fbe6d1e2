/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Items that no client has open: they stay readable until others need their memory or their descriptors. */
#ifndef STORE_LEFTOVER_H
#define STORE_LEFTOVER_H

#include "state.h"

/*
 * The one to be dropped first: written longest ago, and counters only when nothing else is left, since with them goes
 * what a dead program has lost. `except` (or NULL) needs the room; `below`: only an item with a descriptor of a smaller
 * number; `payer`: only an item that this account pays for (NULL: any). NULL: there is none.
 */
struct item *leftover_first(const struct store *store, const struct item *except, int below,
                            const struct checkpoint_account *payer);

/* What dropping all of them would give. */
uint64_t leftover_bytes(const struct store *store, const struct item *except);
unsigned leftover_files(const struct store *store, const struct item *except);

/* `what` is needed for `whom`. Commits: only then are its files closed, and do not count any more. */
void leftover_drop(struct item *victim, const char *what, const char *whom);

#endif
