/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* What the files of this library call of each other. */
#ifndef DDX_ITEM_H
#define DDX_ITEM_H

#include "futex.h"
#include "handle.h"

/* inbox.c: take in what the store said. With `lock` held. 0 or -EPIPE when the store is gone. */
int ddx_item_service(DDX_STORE_ITEM *item);
/* Send, then wait for `answer`. With `lock` held. 0, the answer's status, -ECONNREFUSED. */
int ddx_item_request(DDX_STORE_ITEM *item, const struct ddx_message *message, const struct ddx_layout *layout,
                     uint32_t answer);
void ddx_item_disconnect(DDX_STORE_ITEM *item);
/* After the store came back: connect, and offer it what this handle has. With `lock` held. 0, or -errno. */
int ddx_item_reconnect(DDX_STORE_ITEM *item);

/* writer.c */
int ddx_writer_claim(DDX_STORE_ITEM *item);

/* keeper.c: the thread that listens to the store for all items of this process. */
void ddx_keeper_lock(void);
void ddx_keeper_unlock(void);
int ddx_keeper_add(DDX_STORE_ITEM *item);     /* takes its own lock */
void ddx_keeper_remove(DDX_STORE_ITEM *item); /* afterwards the keeper does not touch it */

#endif
