/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* A handle's roles, reader and writer: their handling of the store's messages, and their end. With `lock` held. */
#ifndef DDX_ROLES_H
#define DDX_ROLES_H

#include "handle.h"

/* ---- Reader: reader_role.c ---- */

/* Reserve a window that is large enough for `shown`. 0, or -errno. */
int ddx_window_make(struct ddx_reader_role *reader, const struct ddx_layout *shown);
/* For a reader that is about to sleep: move the pages of the probable next slot in advance. */
void ddx_window_prepare(struct ddx_reader_role *reader);
/* No frame came: show the former one again. */
void ddx_window_restore(struct ddx_reader_role *reader);
/*
 * No newer frame could be pinned: pin the shown frame again. False if that frame was overwritten, so that the window
 * needs another one. True also if the window shows nothing, or a frame of an epoch that has ended.
 */
bool ddx_window_keep(struct ddx_reader_role *reader);
/* Show the pinned slot of the reader's term. 0, or -errno if the caller's struct cannot hold its value. */
int ddx_window_show(struct ddx_reader_role *reader, unsigned slot);

void ddx_reader_on_epoch(DDX_STORE_ITEM *item, struct ddx_packet *packet);
void ddx_reader_on_slot(struct ddx_reader_role *reader, struct ddx_packet *packet);
void ddx_reader_on_attached(struct ddx_reader_role *reader, struct ddx_packet *packet);

/* Set the number of the newest frame seen, also in the pin page, if there is one. */
void ddx_reader_saw(struct ddx_reader_role *reader, uint64_t sequence);
void ddx_reader_follow(struct ddx_reader_role *reader); /* switch to the coming term, if no frame is held */
void ddx_reader_end(struct ddx_reader_role *reader);

/* ---- Writer: writer_role.c ---- */

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
