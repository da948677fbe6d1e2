/* SPDX-License-Identifier: LGPL-2.1-or-later */
#ifndef DDX_WRITER_H
#define DDX_WRITER_H

#include "handle.h"

/* Become the item's writer, unless this handle is the writer already. With `lock` held. 0, or -errno. */
int ddx_writer_claim(DDX_STORE_ITEM *item);

#endif
