/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Terms of writing and of reading, and offers of both after a restart. */
#ifndef STORE_TERMS_H
#define STORE_TERMS_H

#include "state.h"

/* ---- A writer's term: claim, preparation, begin, end: claim.c ---- */

/* Make more files for the claims in preparation, some for each. Whether there was work to do. */
bool writers_go_on(struct store *store);
void writer_claim(struct client *client, const struct ddx_layout *layout);
void writer_ready(struct client *client, const struct ddx_message *message);
void writer_taken(struct client *client, const struct ddx_message *message);
void writer_left(struct client *client);

/* ---- Terms of reading: readers.c ---- */

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

/*
 * ---- Offers: adopt.c ----
 *
 * After a restart, holders offer their items: the first offer is accepted; a writer's offer takes precedence over a
 * reader's, and a newer epoch over an older one. No part of an offer is trusted before its memory files were checked.
 */

void offer_message(struct client *client, struct ddx_packet *packet);
void offer_abandon(struct client *client);

#endif
