/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Clients: from the first message to the last. */
#ifndef STORE_SESSION_H
#define STORE_SESSION_H

#include <poll.h>

#include "state.h"

struct client *client_add(struct store *store, int socket); /* takes the socket, also on failure (NULL) */
/* Takes in one that has come, if there is a descriptor for it. */
void client_accept(struct store *store);
/* There was none a moment ago: poll() would report the same again and again. */
bool clients_must_wait(void);
/* At most that number of its requests, one after the other; each is committed before any reply is sent. */
void client_receive(struct client *client, unsigned most);

/*
 * A turn of the worker: what poll() found for each client, in the order of their list. No process has more than its
 * share of messages handled, and its other clients come first in the next turn.
 */
void clients_hear(struct store *store, const struct pollfd *found);
void clients_sweep(struct store *store); /* remove the clients that are gone */
/* After the commit, send the pending messages: to this client (or NULL) after all others. */
void clients_tell(struct store *store, struct client *last);

#endif
