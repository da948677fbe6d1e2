/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * After a restart, holders offer their items: the first offer is accepted; a writer's offer takes precedence over
 * a reader's, and a newer epoch over an older one. No part of an offer is trusted before its memory files were
 * checked.
 */
#ifndef STORE_ADOPT_H
#define STORE_ADOPT_H

#include "state.h"

void offer_message(struct client *client, struct ddx_packet *packet);
void offer_abandon(struct client *client);

#endif
