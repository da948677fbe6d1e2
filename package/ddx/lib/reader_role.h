/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* What the store's messages do to a handle's reader, and what ends it. With `lock` held. */
#ifndef DDX_READER_ROLE_H
#define DDX_READER_ROLE_H

#include "handle.h"

void ddx_reader_on_epoch(DDX_STORE_ITEM *item, struct ddx_packet *packet);
void ddx_reader_on_slot(struct ddx_reader_role *reader, struct ddx_packet *packet);
void ddx_reader_on_attached(struct ddx_reader_role *reader, struct ddx_packet *packet);

/* What this reader has seen, from now on; in its pin page, too, if it has one. */
void ddx_reader_saw(struct ddx_reader_role *reader, uint64_t sequence);
void ddx_reader_follow(struct ddx_reader_role *reader); /* go over to the coming term, if nothing is held */
void ddx_reader_end(struct ddx_reader_role *reader);

#endif
