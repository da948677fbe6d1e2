/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Items of this machine that others may read. An item without readers elsewhere is neither read nor sent. */
#ifndef DDXCATALOG_EXPORT_H
#define DDXCATALOG_EXPORT_H

#include "state.h"

/* NULL: no memory. */
struct exports *exports_open(struct catalog *catalog);
void exports_close(struct exports *exports);

/* Withdraw the announcements of this machine and its items; exports_look() announces them again. */
void exports_withdraw(struct exports *exports);

/* Call `take` for each announced item, with its number of readers on other machines. */
typedef void exports_take(void *argument, const char *name, const char *type, unsigned readers);
void exports_each(const struct exports *exports, exports_take *take, void *argument);

/* Follow the store's items, and announce new ones. Waits for the store's answer if an item has changed. */
void exports_look(struct exports *exports, const struct ddx_item_info *items, unsigned count);

#endif
