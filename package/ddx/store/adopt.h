/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * After a restart, items come back from those who hold them: first come, first known; a writer's word counts more than
 * a reader's, and a newer epoch more than an older one. Nothing of an offer is believed before its memory files were
 * looked at.
 */
#ifndef STORE_ADOPT_H
#define STORE_ADOPT_H

#include "state.h"

void offer_message(struct client *client, struct ddx_packet *packet);
void offer_abandon(struct client *client);

#endif
