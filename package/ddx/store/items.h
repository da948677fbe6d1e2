/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Items: their names, types, memory and readers. */
#ifndef STORE_ITEMS_H
#define STORE_ITEMS_H

#include "state.h"

struct item *item_find(const struct store *store, const char *name);
/* NULL and errno: ENOMEM, EDQUOT. */
struct item *item_add(struct store *store, const char *name, const char *type, const struct ddx_layout *layout);

/* As it is written, or as it was declared while there is no epoch; NULL: it is awaited. */
const struct ddx_layout *item_layout(const struct item *item);

/* The item's memory from now on; the former epoch has ended. */
void item_begin_epoch(struct item *item, struct epoch *epoch);

/* Whether readers wait for an item that does not exist yet: it has no type and no layout. */
bool item_is_awaited(const struct item *item);

/* A client creates it. 0, -ENOMEM or -EDQUOT. */
int item_define(struct item *item, const char *type, const struct ddx_layout *layout);
void item_drop_if_unused(struct item *item);
int item_set_notice(struct item *item, int fd); /* takes fd, also on failure */
uint64_t item_bytes(const struct item *item);   /* of what is to be had of it: no epoch that has ended */
uint64_t item_reserved(const struct item *item);
void item_describe(const struct item *item, struct ddx_message *message);

/* The next reader after this one; NULL gives the first one. Returns NULL after the last. */
struct client *item_next_reader(const struct item *item, const struct client *former);

#endif
