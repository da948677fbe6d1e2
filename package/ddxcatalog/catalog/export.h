/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Items of this machine that others may read. Without a reader elsewhere, the store is not read and nothing is sent. */
#ifndef DDXCATALOG_EXPORT_H
#define DDXCATALOG_EXPORT_H

#include "state.h"

/* NULL: no memory. */
struct exports *exports_open(struct catalog *catalog);
void exports_close(struct exports *exports);

/* Say no more that there is this machine, nor its items; exports_look() announces them again. */
void exports_withdraw(struct exports *exports);

/* Calls `take` for each item that others may read; `readers` of it there are. */
typedef void exports_take(void *argument, const char *name, const char *type, unsigned readers);
void exports_each(const struct exports *exports, exports_take *take, void *argument);

/* Follow which items there are, and announce what is new. Waits for the store's answer where an item has changed. */
void exports_look(struct exports *exports, const struct ddx_item_info *items, unsigned count);

#endif
