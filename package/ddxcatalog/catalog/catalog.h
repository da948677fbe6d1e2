/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The catalog of one machine. Threads:
 *   the main one   looks at the store, answers requests, writes what comes from other machines into the store
 *   senders        one for each item that is read elsewhere: reads it, sends it
 *   those of DDS   which are its own
 */
#ifndef DDXCATALOG_CATALOG_H
#define DDXCATALOG_CATALOG_H

#include "state.h"

/* Until told to stop; the program's exit status. */
int catalog_run(struct catalog *catalog);

#endif
