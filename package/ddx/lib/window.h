/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * The paper's stable pointer over a ring of slots: the pages of the pinned slot are moved into a window whose address
 * never changes, and back when the next frame comes. Moving page tables takes ten or twenty microseconds,
 * copying or a new mapping hundreds. A waiting reader moves them beforehand, since the writer's next slot is
 * known; the frame is read only once it is pinned. If another slot comes, the pages are moved then.
 */
#ifndef DDX_WINDOW_H
#define DDX_WINDOW_H

#include "handle.h"

/* Large enough for `shown`. 0, or -errno. */
int ddx_window_make(struct ddx_reader_role *reader, const struct ddx_layout *shown);
/* For a reader that is about to sleep: most of what the next frame needs is done when it comes. */
void ddx_window_prepare(struct ddx_reader_role *reader);
/* No frame came: the former one is shown again. */
void ddx_window_restore(struct ddx_reader_role *reader);
/*
 * No newer frame could be pinned: pin again what the window shows. False if that was written over meanwhile, so that
 * the window needs another one. True also if it shows nothing, or one of an epoch that has ended.
 */
bool ddx_window_keep(struct ddx_reader_role *reader);
/* Show the slot of the reader's term, which is pinned. 0, or why the caller's struct cannot take it. */
int ddx_window_show(struct ddx_reader_role *reader, unsigned slot);
/* The window shows nothing that anybody may rely on. */
void ddx_window_withdraw(struct ddx_reader_role *reader);

#endif
