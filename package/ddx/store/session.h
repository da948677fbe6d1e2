/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Clients: from the first message to the last. */
#ifndef STORE_SESSION_H
#define STORE_SESSION_H

#include "state.h"

struct client *client_add(struct store *store, int socket); /* takes the socket, also on failure (NULL) */
/* Its requests, one after the other; each is committed before anybody hears what came of it. */
void client_receive(struct client *client);
void clients_sweep(struct store *store); /* forget those who are gone */
/* Now that it is committed, what is to be said: to this client (or NULL) after all others. */
void clients_tell(struct store *store, struct client *last);

#endif
