/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The items catalog.machines (this machine's name, and the other machines) and catalog.items (their items). */
#ifndef DDXCATALOG_TABLE_H
#define DDXCATALOG_TABLE_H

#include "state.h"
#include "machines.h"

struct table;

/* NULL: no memory. If an item cannot be created, the table works without it, after a line. */
struct table *table_open(struct catalog *catalog);

/* The items then show that no catalog runs. NULL is allowed. */
void table_close(struct table *table);

/* Write the current state, if it has changed apart from clocks, or if `clocks` is set. */
void table_write(struct table *table, const struct machines *machines, bool clocks);

#endif
