/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * A restarted store knows no items. Each holder of an item offers its memory files, so that the new store
 * learns of the item. Frames flow throughout.
 */
#ifndef DDX_REOFFER_H
#define DDX_REOFFER_H

#include "handle.h"

/*
 * Connect, and say it all. With `lock` held. 0, or -errno: the store does not listen, or, if there is a socket all the
 * same, hung up meanwhile.
 */
int ddx_item_reoffer(DDX_STORE_ITEM *item);

#endif
