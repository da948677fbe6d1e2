/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Epochs that have ended. A client that is stopped, or has not read yet that the next epoch has begun, still maps the
 * old memory, so that memory counts until the kernel reports that no process has it.
 */
#ifndef STORE_RETIRED_H
#define STORE_RETIRED_H

#include "state.h"

void epoch_retire(struct item *item, struct epoch *epoch); /* takes ownership; NULL is allowed */
uint64_t retired_bytes(const struct store *store, const struct item *item); /* NULL: of dropped items */
void retired_sweep(struct store *store);
void retired_forget(const struct item *item); /* it is being dropped */

#endif
