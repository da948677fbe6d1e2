/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Epochs that have ended. A client that still has one, because it is stopped or has not read that the next one has
 * begun, keeps its memory, so the memory counts until the kernel reports that no process has it.
 */
#ifndef STORE_RETIRED_H
#define STORE_RETIRED_H

#include "state.h"

void epoch_retire(struct item *item, struct epoch *epoch); /* takes it; NULL is none */
uint64_t retired_bytes(const struct store *store, const struct item *item); /* NULL: of items that are no more */
void retired_sweep(struct store *store);
void retired_forget(const struct item *item); /* it is no more */

#endif
