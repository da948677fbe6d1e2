/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A topic with the values of an item. While it has readers, a thread reads the item and sends its values. */
#ifndef DDXCATALOG_OUTLET_H
#define DDXCATALOG_OUTLET_H

#include <standard.h>

#include "state.h"

struct outlet;

/* Source and destination of the values. All objects are the caller's and must outlive the outlet. */
struct sender_source {
    const struct config_rule *rule;
    const char *item;
    const struct form *form;   /* of the item's current layout */
    struct standard *standard; /* the message; NULL: the item's own type, with sequence numbers */
    struct network_writer *writer;
};

/*
 * `source->writer` is ignored. The outlet takes ownership of `standard`, also on failure; the caller's other objects in
 * `source` must outlive the outlet. 0 or -errno.
 */
int outlet_open(struct catalog *catalog, const char *topic, const struct sender_source *source, struct outlet **outlet);

/* NULL is allowed. */
void outlet_close(struct outlet *outlet);

/* The number of readers now. NULL is allowed. */
unsigned outlet_readers(const struct outlet *outlet);

/*
 * Count the readers again, in case the event of one that left was missed: otherwise the item would be read and sent
 * until the next event. Start the thread again if it has exited by itself, or could not be started. NULL is allowed.
 */
void outlet_look(struct outlet *outlet);

#endif
