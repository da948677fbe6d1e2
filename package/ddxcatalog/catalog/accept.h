/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Items of this store that programs of other machines may write, according to exports.conf. */
#ifndef DDXCATALOG_ACCEPT_H
#define DDXCATALOG_ACCEPT_H

#include "state.h"

struct accepts;

/* NULL: no memory. */
struct accepts *accepts_open(struct catalog *catalog);
void accepts_close(struct accepts *accepts); /* NULL is allowed */

/* Follow the store's items: an item accepts values only after a program of this machine has declared it. */
void accepts_look(struct accepts *accepts, const struct ddx_item_info *items, unsigned count);

#endif
