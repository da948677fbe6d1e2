/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Terms of reading. */
#ifndef STORE_READERS_H
#define STORE_READERS_H

#include "state.h"

/*
 * Whether the request has to be looked at in the next turn, too, before it is handled: it is for more new memory than
 * one turn makes, and some was made now.
 */
bool reader_must_wait(struct client *client, unsigned keep);
void reader_attach(struct client *client, unsigned keep);
/* Its writer checks its pins, or (-errno) does not; the reader is notified if it has asked. */
void reader_taken(struct client *client, int status);
/*
 * Whether any of them waits for that. A stopped writer delays no reader for long: when the message is in its
 * socket, and the notice says so, it reads the message before it writes.
 */
bool readers_wait(struct store *store);
/* There is no writer any more: waiting readers are admitted, unless the writer lives and may come back. */
void readers_without_writer(struct item *item);
/* Give the writer as many slots as there are pins, plus the newest and the one being written. 0 or -EBUSY. */
int reader_add_slots(struct item *item, unsigned keep, unsigned pages);
int reader_register(struct client *client, int pin_fd, unsigned keep);
void reader_left(struct client *client);

#endif
