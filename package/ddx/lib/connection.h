/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* What a handle says to the store, which may be slow or stopped while frames flow on: nothing here waits for it. */
#ifndef DDX_CONNECTION_H
#define DDX_CONNECTION_H

#include "handle.h"

/*
 * The keeper's eventfd, which it makes and closes; -1 while it does not run. Thus this layer does not depend on the
 * keeper.
 */
extern int ddx_connection_waker __attribute__((visibility("hidden")));

void ddx_message_init(struct ddx_message *message, uint32_t operation, const DDX_STORE_ITEM *item);

/* A new connection to the store, over which nothing was said yet. 0, or -errno, and then the handle is as before. */
int ddx_connection_open(DDX_STORE_ITEM *item);

/* Send, or leave to the keeper what the socket does not hold. With `lock` held. As ddx_queue_send(). */
int ddx_connection_say(DDX_STORE_ITEM *item, const struct ddx_message *message, const struct ddx_layout *layout,
                 const int *fds, unsigned fd_count);

/* Have the keeper look at all items. */
void ddx_connection_wake_keeper(void);

#endif
