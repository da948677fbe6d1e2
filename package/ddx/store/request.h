/* SPDX-License-Identifier: GPL-2.0-or-later */
/* One message of a client. */
#ifndef STORE_REQUEST_H
#define STORE_REQUEST_H

#include "state.h"

/* Whether it waits for the next turn, in which it is looked at again: see reader_must_wait(). */
bool request_must_wait(struct client *client, const struct ddx_packet *packet);
void request_handle(struct client *client, struct ddx_packet *packet);
/* Whether its answer depends on other clients' holdings: dead clients must be removed first. */
bool request_counts(const struct ddx_packet *packet);
/* Some of the list; the rest when the client has read that. */
void list_continue(struct client *client);

#endif
