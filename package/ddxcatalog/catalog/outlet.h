/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A topic with the values of an item. While it has readers, a thread reads the item and sends its values. */
#ifndef DDXCATALOG_OUTLET_H
#define DDXCATALOG_OUTLET_H

#include "sender.h"

struct outlet;

/*
 * `source->writer` is ignored. The outlet takes ownership of `standard`, also on failure; the caller's other objects in
 * `source` must outlive the outlet. 0 or -errno.
 */
int outlet_open(struct catalog *catalog, const char *topic, const struct sender_source *source, struct outlet **outlet);

/* NULL is allowed. */
void outlet_close(struct outlet *outlet);

/* The number of readers now. NULL is allowed. */
unsigned outlet_readers(const struct outlet *outlet);

/* Start the thread again if it has exited by itself, or could not be started. NULL is allowed. */
void outlet_look(struct outlet *outlet);

#endif
