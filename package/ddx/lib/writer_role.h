/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* A handle's writer: its handling of the store's messages, and its end. With `lock` held. */
#ifndef DDX_WRITER_ROLE_H
#define DDX_WRITER_ROLE_H

#include "handle.h"

void ddx_writer_on_reader(DDX_STORE_ITEM *item, struct ddx_packet *packet);
void ddx_writer_on_reader_gone(struct ddx_writer_role *writer, const struct ddx_message *m);

/*
 * Remove readers whose pin page no process holds any more: only leaving ones, or `all`. The store's READER_GONE is not
 * sufficient, because the store may have disconnected a reader that was only stopped. True if any was removed.
 */
bool ddx_writer_forget(struct ddx_writer_role *writer, bool all);

void ddx_writer_on_claimed(DDX_STORE_ITEM *item, struct ddx_packet *packet); /* its term begins */
void ddx_writer_on_slot(DDX_STORE_ITEM *item, struct ddx_packet *packet);
void ddx_writer_on_slot_told(struct ddx_writer_role *writer, const struct ddx_message *m); /* readers know it */
void ddx_writer_on_done(struct ddx_writer_role *writer, const struct ddx_message *m);
void ddx_writer_on_offered(struct ddx_writer_role *writer, const struct ddx_message *m);

void ddx_writer_end(struct ddx_writer_role *writer);

#endif
