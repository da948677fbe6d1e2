/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Items that no client has open: they remain readable until other items need their memory or their descriptors. */
#ifndef STORE_LEFTOVER_H
#define STORE_LEFTOVER_H

#include "state.h"

/*
 * The item to drop first: the one written longest ago; counters only if no other item is left, because they record the
 * frames that a dead program has lost. Not `except` (or NULL), which needs the room; `below`: only an item with a
 * descriptor below this number; `payer`: only an item charged to this account (NULL: any). NULL: there is none.
 */
struct item *leftover_first(const struct store *store, const struct item *except, int below,
                            const struct checkpoint_account *payer);

/* Memory and descriptors that dropping all of these items would free. */
uint64_t leftover_bytes(const struct store *store, const struct item *except);
unsigned leftover_files(const struct store *store, const struct item *except);

/* Drop the item because `whom` needs `what` (for the log). Commits, which closes the item's files. */
void leftover_drop(struct item *victim, const char *what, const char *whom);

#endif
