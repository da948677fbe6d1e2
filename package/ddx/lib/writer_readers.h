/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* The readers whose pins a writer checks: admitting and removing them. With `lock` held. */
#ifndef DDX_WRITER_READERS_H
#define DDX_WRITER_READERS_H

#include "handle.h"

void ddx_writer_on_reader(DDX_STORE_ITEM *item, struct ddx_packet *packet);
void ddx_writer_on_reader_gone(struct ddx_writer_role *writer, const struct ddx_message *m);

/*
 * Remove readers whose pin page no process holds any more: only leaving ones, or `all`. The store's READER_GONE is not
 * sufficient, because the store may have disconnected a reader that was only stopped. True if any was removed.
 */
bool ddx_writer_forget(struct ddx_writer_role *writer, bool all);

#endif
