/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A topic with the values of an item. As long as it has readers, a thread reads the item and sends its values. */
#ifndef DDXCATALOG_OUTLET_H
#define DDXCATALOG_OUTLET_H

#include "sender.h"

struct outlet;

/*
 * `source` without its writer; what it points at outlives the outlet, but for `standard`, which is the outlet's from
 * then on, also where it fails. 0 or -errno.
 */
int outlet_open(struct catalog *catalog, const char *topic, const struct sender_source *source, struct outlet **outlet);

/* NULL is allowed. */
void outlet_close(struct outlet *outlet);

/* How many there are now. NULL is allowed. */
unsigned outlet_readers(const struct outlet *outlet);

/* See whether the thread has ended by itself. NULL is allowed. */
void outlet_look(struct outlet *outlet);

#endif
