/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A thread that sends the values of one item. */
#ifndef DDXCATALOG_SENDER_H
#define DDXCATALOG_SENDER_H

#include <standard.h>

#include "state.h"

struct sender;

/* What is sent, and where. All of it is the caller's and outlives the sender. */
struct sender_source {
    const struct config_rule *rule;
    const char *item;
    const struct form *form;   /* how the item's values lie now */
    struct standard *standard; /* the message; NULL: the item's own type, with its sequence */
    struct network_writer *writer;
};

/* Bytes of a message at most. */
size_t sender_message_size(const struct catalog *catalog, const struct sender_source *source);

/*
 * Begins with the newest value. `sent`, how many messages were sent so far, is the caller's and outlives the sender.
 * NULL and errno.
 */
struct sender *sender_start(struct catalog *catalog, const struct sender_source *source, uint64_t *sent);

/* A reader has come: the newest value is sent once more. */
void sender_repeat(struct sender *sender);

/* Whether it has ended by itself: the item has another form, or cannot be read. */
bool sender_ended(const struct sender *sender);

/* NULL is allowed. */
void sender_stop(struct sender *sender);

#endif
