/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Handling of one message of a client. */
#ifndef STORE_REQUEST_H
#define STORE_REQUEST_H

#include "state.h"

/* Whether the message must wait for the next turn: see reader_must_wait(). */
bool request_must_wait(struct client *client, const struct ddx_packet *packet);
void request_handle(struct client *client, struct ddx_packet *packet);
/* Whether the answer depends on other clients: then dead clients must be removed first. */
bool request_counts(const struct ddx_packet *packet);
/* Send the next part of the list; the rest follows when the client has read that part. */
void list_continue(struct client *client);

#endif
