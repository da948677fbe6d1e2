/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A thread that sends the values of one item. */
#ifndef DDXCATALOG_SENDER_H
#define DDXCATALOG_SENDER_H

#include <standard.h>

#include "state.h"

struct sender;

/* Source and destination of a sender. All objects are the caller's and must outlive the sender. */
struct sender_source {
    const struct config_rule *rule;
    const char *item;
    const struct form *form;   /* of the item's current layout */
    struct standard *standard; /* the message; NULL: the item's own type, with sequence numbers */
    struct network_writer *writer;
};

/* Maximum size of a message in bytes. */
size_t sender_message_size(const struct catalog *catalog, const struct sender_source *source);

/*
 * Start a sender, which begins with the newest value. *sent, the number of messages sent so far, is the caller's and
 * must outlive the sender. NULL and errno.
 */
struct sender *sender_start(struct catalog *catalog, const struct sender_source *source, uint64_t *sent);

/* Send the newest value again, for a new reader. */
void sender_repeat(struct sender *sender);

/* Whether the thread has exited by itself: the item has another form, or cannot be read. */
bool sender_ended(const struct sender *sender);

/* NULL is allowed. */
void sender_stop(struct sender *sender);

#endif
