/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Notifications to the holders of an item: slots and readers to the writer, epochs and slots to readers. */
#ifndef STORE_NOTIFY_H
#define STORE_NOTIFY_H

#include "state.h"

/* To the writer, which answers with TAKEN: see reader_taken(). */
void notify_reader(struct item *item, struct client *reader);
void notify_readers(struct item *item); /* all of them */
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
