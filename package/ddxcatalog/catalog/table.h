/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Items catalog.machines, what this machine is called, and which others there are; and catalog.items, theirs. */
#ifndef DDXCATALOG_TABLE_H
#define DDXCATALOG_TABLE_H

#include "state.h"
#include "machines.h"

struct table;

/* NULL: no memory. Where the item cannot be created, a table that shows nothing, after a line. */
struct table *table_open(struct catalog *catalog);

/* The item then says that no catalog runs. NULL is allowed. */
void table_close(struct table *table);

/* Show how it is now, if something but clocks has changed, or if `clocks` asks for these. */
void table_write(struct table *table, const struct machines *machines, bool clocks);

#endif
