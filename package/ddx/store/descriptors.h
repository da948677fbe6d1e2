/* SPDX-License-Identifier: GPL-2.0-or-later */
/* If frames are small, descriptors run out before memory does: then items that no client has open are dropped. */
#ifndef STORE_DESCRIPTORS_H
#define STORE_DESCRIPTORS_H

#include "state.h"

/*
 * Free `count` descriptors for the item by dropping other items. False, and no item is dropped, if that would not free
 * enough.
 */
bool descriptors_for_item(struct item *item, unsigned count);

/* The same for one descriptor with a number below `number`. */
bool descriptors_below(struct store *store, int number);

#endif
