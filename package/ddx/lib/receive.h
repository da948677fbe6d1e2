/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Taking in what the store says: answers to requests, and news. With `lock` held. */
#ifndef DDX_RECEIVE_H
#define DDX_RECEIVE_H

#include "handle.h"

/* All that is there. 0 or -EPIPE when the store is gone. */
int ddx_item_service(DDX_STORE_ITEM *item);
/* Send, then wait for `answer`. 0, the answer's status, -ECONNREFUSED. */
int ddx_item_request(DDX_STORE_ITEM *item, const struct ddx_message *message, const struct ddx_layout *layout,
                     uint32_t answer);
void ddx_item_disconnect(DDX_STORE_ITEM *item);
/* After the store came back: connect, and offer it what this handle has. 0, or -errno. */
int ddx_item_reconnect(DDX_STORE_ITEM *item);

#endif
