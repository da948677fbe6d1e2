/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Messages to clients, and when they are sent. */
#ifndef STORE_SEND_H
#define STORE_SEND_H

#include "state.h"

/* After the commit, and when there is room in its socket. Descriptors stay the caller's. */
void client_send(struct client *client, const struct ddx_message *message, const struct ddx_layout *layout,
                 const int *fds, unsigned count);
void client_reply(struct client *client, uint32_t operation, int status);

/* Sends to all clients as much as their sockets take; to `last` (or NULL) last. Whether a message was waiting. */
bool clients_go_on(struct store *store, struct client *last);

/*
 * Whether its process has more than a quarter of our descriptors in incomplete offers and unread messages; a whole
 * item is allowed in any case.
 */
bool client_holds_too_much(const struct client *client);

#endif
