/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Items "carol:gps" of this store, which follow items of other machines while they have a reader here. */
#ifndef DDXCATALOG_MIRROR_H
#define DDXCATALOG_MIRROR_H

#include "directory.h"

/* NULL: no memory. */
struct mirrors *mirrors_open(struct catalog *catalog);
void mirrors_close(struct mirrors *mirrors);

/*
 * Make an item of this name that follows the origin; for "carol:" only find the machine. 0, errors of directory_find()
 * and of ddx_store_create(); -EPROTO: the network does not support the type.
 */
int mirrors_want(struct mirrors *mirrors, const char *name);

/* Follow the announcements and the readers here; `items`: the store's list. To be called regularly. */
void mirrors_look(struct mirrors *mirrors, const struct ddx_item_info *items, unsigned count);

#endif
