/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Queued messages to clients. */
#ifndef STORE_SEND_H
#define STORE_SEND_H

#include "state.h"

/* Queue a message. It is sent after the commit, when the socket has room. The caller keeps the descriptors. */
void client_send(struct client *client, const struct ddx_message *message, const struct ddx_layout *layout,
                 const int *fds, unsigned count);
void client_reply(struct client *client, uint32_t operation, int status);

/* Send to all clients as much as their sockets take; to `last` (or NULL) last. Whether a message was waiting. */
bool clients_go_on(struct store *store, struct client *last);

/*
 * Whether the client's process has more than a quarter of the store's descriptors in incomplete offers and unread
 * messages; the descriptors of one whole item are allowed in any case.
 */
bool client_holds_too_much(const struct client *client);

#endif
