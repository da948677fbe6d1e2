/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Terms of reading. */
#ifndef STORE_READERS_H
#define STORE_READERS_H

#include "state.h"

/*
 * Whether the request must wait for the next turn: it needs more new memory than one turn makes, and this turn has made
 * some of it.
 */
bool reader_must_wait(struct client *client, unsigned keep);
void reader_attach(struct client *client, unsigned keep);
/* The writer checks this reader's pins, or (-errno) cannot; answers the reader's request, if it has made one. */
void reader_taken(struct client *client, int status);
/*
 * Whether any reader waits for that. A stopped writer does not delay readers for long: once the message is in its
 * socket, and the notice says so, the writer will read the message before its next write.
 */
bool readers_wait(struct store *store);
/* The writer has left: admit waiting readers, unless the writer lives and may come back. */
void readers_without_writer(struct item *item);
/* Add slots until there is one for each pin, the newest frame and the one being written. 0 or -EBUSY. */
int reader_add_slots(struct item *item, unsigned keep, unsigned pages);
int reader_register(struct client *client, int pin_fd, unsigned keep);
void reader_left(struct client *client);

#endif
