/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What is said to clients, and when. */
#ifndef STORE_SEND_H
#define STORE_SEND_H

#include "state.h"

/* After the commit, and when there is room in its socket. Descriptors stay the caller's. */
void client_send(struct client *client, const struct ddx_message *message, const struct ddx_layout *layout,
                 const int *fds, unsigned count);
void client_reply(struct client *client, uint32_t operation, int status);

/* Send to all what they have room for; to this one (or NULL) last. Whether there was anything. */
bool clients_go_on(struct store *store, struct client *last);

/*
 * What is kept for its process, besides connections and items: offers that are not complete, and messages that it has
 * not read. A quarter of our descriptors, but a whole item in any case.
 */
bool client_holds_too_much(const struct client *client);

#endif
