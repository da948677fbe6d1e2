/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Items: their names, types, memory and readers. */
#ifndef STORE_ITEMS_H
#define STORE_ITEMS_H

#include "state.h"

void epoch_retire(struct item *item, struct epoch *epoch);                  /* takes ownership; NULL is allowed */
uint64_t retired_bytes(const struct store *store, const struct item *item); /* NULL: of dropped items */
void retired_sweep(struct store *store);

struct item *item_find(const struct store *store, const char *name);
/* NULL and errno: ENOMEM, EDQUOT. */
struct item *item_add(struct store *store, const char *name, const char *type, const struct ddx_layout *layout);

/* The layout of the current epoch, or the declared one while there is no epoch; NULL: the item is awaited. */
const struct ddx_layout *item_layout(const struct item *item);

/* Make this epoch the item's current one; the former epoch ends. */
void item_begin_epoch(struct item *item, struct epoch *epoch);

/* Whether readers wait for this item, which no client has created: it has no type and no layout. */
bool item_is_awaited(const struct item *item);

/* A client creates the item. 0, -ENOMEM or -EDQUOT. */
int item_define(struct item *item, const char *type, const struct ddx_layout *layout);
void item_drop_if_unused(struct item *item);
int item_set_notice(struct item *item, int fd); /* takes fd, also on failure */
uint64_t item_bytes(const struct item *item);   /* of the current and pending epochs, without retired ones */
uint64_t item_reserved(const struct item *item);
void item_describe(const struct item *item, struct ddx_message *message);

/* The reader after `former` (NULL: the first one), or NULL after the last. */
struct client *item_next_reader(const struct item *item, const struct client *former);

#endif
