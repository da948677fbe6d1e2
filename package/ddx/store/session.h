/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Connections of clients, and how a worker begins. */
#ifndef STORE_SESSION_H
#define STORE_SESSION_H

#include <poll.h>

#include "state.h"

struct client *client_add(struct store *store, int socket); /* takes the socket, also on failure (NULL) */
/* Accept one waiting connection, if there is a descriptor for it. */
void client_accept(struct store *store);
/* A moment ago there was no descriptor: do not poll the listener, since poll() would return at once each time. */
bool clients_must_wait(void);
/* Handle at most `most` requests, one after the other; each is committed before any reply is sent. */
void client_receive(struct client *client, unsigned most);

/*
 * A turn of the worker: `found` is the result of poll() for each client, in the order of their list. For no process are
 * more messages handled than its share; the clients that had to wait come first in the next turn.
 */
void clients_hear(struct store *store, const struct pollfd *found);
void clients_sweep(struct store *store); /* remove disconnected clients */
/* After the commit, send the pending messages: to `last` (or NULL) after all others. */
void clients_tell(struct store *store, struct client *last);

/* ---- Begin of a worker, as the first or as a successor: resume.c ---- */

void store_memory(void);                                    /* keep queued messages in checkpointed memory */
struct store *store_begin(const struct settings *settings); /* the first worker's state; NULL: no memory */
struct store *store_take_over(void);                        /* the previous worker's state */

#endif
