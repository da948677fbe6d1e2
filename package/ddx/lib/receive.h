/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Receiving the store's messages: answers and notifications. With `lock` held. */
#ifndef DDX_RECEIVE_H
#define DDX_RECEIVE_H

#include "handle.h"

/* Handle all waiting messages. 0; -EPIPE: the store has disconnected. */
int ddx_item_service(DDX_STORE_ITEM *item);
/* Send, then wait for `answer`. 0, the answer's status, -ECONNREFUSED. */
int ddx_item_request(DDX_STORE_ITEM *item, const struct ddx_message *message, const struct ddx_layout *layout,
                     uint32_t answer);
void ddx_item_disconnect(DDX_STORE_ITEM *item);
/* After a restart of the store: connect, and offer this handle's memory files. 0, or -errno. */
int ddx_item_reconnect(DDX_STORE_ITEM *item);

#endif
