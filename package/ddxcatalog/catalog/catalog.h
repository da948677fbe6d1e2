/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The catalog of one machine. Threads:
 *   main      follows the store's items, answers requests, writes values of other machines into the store
 *   senders   one for each item that another machine reads: reads the item, sends its values
 *   DDS       has threads of its own
 */
#ifndef DDXCATALOG_CATALOG_H
#define DDXCATALOG_CATALOG_H

#include "state.h"

/* Run until a request to stop; returns the program's exit status. */
int catalog_run(struct catalog *catalog);

#endif
