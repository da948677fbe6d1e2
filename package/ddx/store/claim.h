/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A writer's term: claim, preparation, begin, end. */
#ifndef STORE_CLAIM_H
#define STORE_CLAIM_H

#include "state.h"

/* Make more files for the claims in preparation, some for each. Whether there was work to do. */
bool writers_go_on(struct store *store);
void writer_claim(struct client *client, const struct ddx_layout *layout);
void writer_ready(struct client *client, const struct ddx_message *message);
void writer_taken(struct client *client, const struct ddx_message *message);
void writer_left(struct client *client);

#endif
