/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Opening items of this machine's store; request.c adds the items of other machines. */
#ifndef DDX_ITEM_H
#define DDX_ITEM_H

#include "handle.h"

/* Wait for the store until `deadline`. 0 or -errno. */
int ddx_local_open(int port, int64_t deadline, DDX_STORE_ID **id);

/* As ddx_store_lookup_item(). 0 or -errno. */
int ddx_local_lookup(DDX_STORE_ID *id, const char *name, const char *type, int size, DDX_STORE_ITEM **item);

#endif
