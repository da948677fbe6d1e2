/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * The keeper: one thread per process that receives the store's messages for all items. It maps new slots, readers and
 * epochs before the frame path needs them, and offers the items to a restarted store, even while the program itself
 * sleeps.
 */
#ifndef DDX_KEEPER_H
#define DDX_KEEPER_H

#include "handle.h"

/* Both take the keeper's lock. */
int ddx_keeper_add(DDX_STORE_ITEM *item);
void ddx_keeper_remove(DDX_STORE_ITEM *item); /* after that the keeper does not use the item */

#endif
