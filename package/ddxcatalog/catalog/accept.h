/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Items of this store that programs of other machines may write, since exports.conf says so. */
#ifndef DDXCATALOG_ACCEPT_H
#define DDXCATALOG_ACCEPT_H

#include "state.h"

struct accepts;

/* NULL: no memory. */
struct accepts *accepts_open(struct catalog *catalog);
void accepts_close(struct accepts *accepts); /* NULL is allowed */

/* Follow which items there are: a program of this machine must have declared an item before it takes values. */
void accepts_look(struct accepts *accepts, const struct ddx_item_info *items, unsigned count);

#endif
