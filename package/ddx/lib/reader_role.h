/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* A handle's reader: its handling of the store's messages, and its end. With `lock` held. */
#ifndef DDX_READER_ROLE_H
#define DDX_READER_ROLE_H

#include "handle.h"

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

#endif
