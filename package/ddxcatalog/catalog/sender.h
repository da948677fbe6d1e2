/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A thread that sends the values of one item. */
#ifndef DDXCATALOG_SENDER_H
#define DDXCATALOG_SENDER_H

#include "catalog.h"

struct sender;

/*
 * Begins with the newest value. `form`, which is how the item's values lie now, `writer` and `sent`, how many messages
 * were sent so far, are the caller's and outlive the sender. NULL and errno.
 */
struct sender *sender_start(struct catalog *catalog, const struct config_rule *rule, const char *item,
                            const struct form *form, struct network_writer *writer, uint64_t *sent);

/* A reader has come: the newest value is sent once more. */
void sender_repeat(struct sender *sender);

/* Whether it has ended by itself: the item has another form, or cannot be read. */
bool sender_ended(const struct sender *sender);

/* NULL is allowed. */
void sender_stop(struct sender *sender);

#endif
