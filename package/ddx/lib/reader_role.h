/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* A handle's reader: its handling of the store's messages, and its end. With `lock` held. */
#ifndef DDX_READER_ROLE_H
#define DDX_READER_ROLE_H

#include "handle.h"

void ddx_reader_on_epoch(DDX_STORE_ITEM *item, struct ddx_packet *packet);
void ddx_reader_on_slot(struct ddx_reader_role *reader, struct ddx_packet *packet);
void ddx_reader_on_attached(struct ddx_reader_role *reader, struct ddx_packet *packet);

/* Set the number of the newest frame seen, also in the pin page, if there is one. */
void ddx_reader_saw(struct ddx_reader_role *reader, uint64_t sequence);
void ddx_reader_follow(struct ddx_reader_role *reader); /* switch to the coming term, if no frame is held */
void ddx_reader_end(struct ddx_reader_role *reader);

#endif
