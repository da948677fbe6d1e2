/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * A restarted store knows no items. Each holder of an item offers its memory files, from which the new store
 * reconstructs the item. Frames continue to flow.
 */
#ifndef DDX_REOFFER_H
#define DDX_REOFFER_H

#include "handle.h"

/*
 * Connect, and send the whole offer. With `lock` held. 0, or -errno: the store does not listen or, if item->socket is
 * open nevertheless, has disconnected.
 */
int ddx_item_reoffer(DDX_STORE_ITEM *item);

#endif
