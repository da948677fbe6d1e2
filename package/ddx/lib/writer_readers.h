/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* The readers whose pins a writer checks: admitting and removing them. With `lock` held. */
#ifndef DDX_WRITER_READERS_H
#define DDX_WRITER_READERS_H

#include "handle.h"

void ddx_writer_on_reader(DDX_STORE_ITEM *item, struct ddx_packet *packet);
void ddx_writer_on_reader_gone(struct ddx_writer_role *writer, const struct ddx_message *m);

/*
 * Remove readers whose pin page no process holds any more: those that are leaving, or all of them. The store's message
 * is not enough, because it may have disconnected a reader that was only stopped. True if there were any.
 */
bool ddx_writer_forget(struct ddx_writer_role *writer, bool all);

#endif
