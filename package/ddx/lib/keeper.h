/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * One thread per process listens to the store on behalf of all items: it takes in new slots, readers and epochs before
 * the frame path needs them, and offers everything again after the store was restarted, even if the program itself
 * sleeps.
 */
#ifndef DDX_KEEPER_H
#define DDX_KEEPER_H

#include "handle.h"

/* Both take the keeper's lock. */
int ddx_keeper_add(DDX_STORE_ITEM *item);
void ddx_keeper_remove(DDX_STORE_ITEM *item); /* afterwards the keeper does not touch it */

#endif
