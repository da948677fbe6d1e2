/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What the holders of an item are told: the writer of slots and readers, readers of epochs and slots. */
#ifndef STORE_NOTIFY_H
#define STORE_NOTIFY_H

#include "state.h"

/* To the writer, which answers with TAKEN: see reader_taken(). */
void notify_reader(struct item *item, struct client *reader);
void notify_readers(struct item *item); /* all of them */
void notify_slots(const struct item *item, struct epoch *epoch, struct client *writer); /* those it has not heard of */

/* To a reader; to all that may hear of it. */
void notify_epoch(const struct item *item, struct client *reader);
void notify_epoch_to_all(const struct item *item);
/* One more of the current epoch, to all that may hear of it. */
void notify_slot_to_all(const struct item *item, unsigned slot);

/* Count the readers for whom frames are kept: once the writer has their slots, and they know them. */
void readers_count(struct item *item);
void readers_tell(const struct store *store); /* to all writers, after all other messages */

#endif
