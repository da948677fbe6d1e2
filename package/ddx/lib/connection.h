/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* A handle's connection to the store. Never waits: the store may be slow or stopped while frames continue to flow. */
#ifndef DDX_CONNECTION_H
#define DDX_CONNECTION_H

#include "handle.h"

/*
 * The keeper's eventfd, opened and closed by the keeper; -1 while the keeper does not run. A variable, so that this
 * layer does not depend on the keeper.
 */
extern int ddx_connection_waker __attribute__((visibility("hidden")));

void ddx_message_init(struct ddx_message *message, uint32_t operation, const DDX_STORE_ITEM *item);

/* Open a new connection to the store. 0, or -errno, and then the handle is unchanged. */
int ddx_connection_open(DDX_STORE_ITEM *item);

/* Send; the keeper sends the messages that the socket does not take now. With `lock` held. As ddx_queue_send(). */
int ddx_connection_say(DDX_STORE_ITEM *item, const struct ddx_message *message, const struct ddx_layout *layout,
                 const int *fds, unsigned fd_count);

/* Have the keeper look at all items. */
void ddx_connection_wake_keeper(void);

#endif
