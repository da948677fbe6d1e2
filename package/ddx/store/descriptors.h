/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Descriptors are short before memory is where frames are small: then items that no client has open are dropped. */
#ifndef STORE_DESCRIPTORS_H
#define STORE_DESCRIPTORS_H

#include "state.h"

/*
 * Free that number of descriptors for the item, if dropping other items is sufficient; otherwise no item is dropped,
 * and the result is false.
 */
bool descriptors_for_item(struct item *item, unsigned count);

/* The same for one descriptor of a smaller number than this. False: none could be had. */
bool descriptors_below(struct store *store, int number);

#endif
