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

/* To the writer, which answers with TAKEN: see reader_taken(). */
void notify_reader(struct item *item, struct client *reader);
void notify_readers(struct item *item);                                                 /* all of them */
void notify_slots(const struct item *item, struct epoch *epoch, struct client *writer); /* slots not yet sent to it */

/* To one reader; to all admitted readers. */
void notify_epoch(const struct item *item, struct client *reader);
void notify_epoch_to_all(const struct item *item);
/* A new slot of the current epoch, to all admitted readers. */
void notify_slot_to_all(const struct item *item, unsigned slot);

/* Count the readers that frames are kept for: those whose slots the writer has, once they know them. */
void readers_count(struct item *item);
void readers_tell(const struct store *store); /* publish the counts to all writers, after all other messages */

#endif
