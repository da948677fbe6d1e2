/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * The paper's stable pointer over a ring of slots: the pages of the pinned slot are moved into a window whose address
 * never changes, and back when the next frame comes. Moving page tables takes 10 to 20 us; copying, or a new mapping,
 * hundreds. A waiting reader moves the pages of the writer's probable next slot in advance; it reads the frame only
 * once the slot is pinned. If the frame comes in another slot, the pages are moved then.
 */
#ifndef DDX_WINDOW_H
#define DDX_WINDOW_H

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
/* The content of the window is undefined from now on. */
void ddx_window_withdraw(struct ddx_reader_role *reader);

#endif
