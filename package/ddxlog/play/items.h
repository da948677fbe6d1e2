/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The items that a replay writes. */
#ifndef DDXLOG_ITEMS_H
#define DDXLOG_ITEMS_H

#include "replay_state.h"

/* One for each topic; its layout may change from channel to channel. */
struct replay_item {
    struct replay_item *next;
    const char *topic;
    char name[DDX_NAME_MAX + 1];
    DDX_STORE_ITEM *handle;
    struct form *form; /* of the item's current layout */
    uint16_t channel;  /* the channel that has this layout; 0: none */
    bool refused;      /* reported and left out, for example because another program writes it */
};

/* Create all items of the log. Returns their number. */
unsigned items_create(struct replay *replay);
void items_free(struct replay *replay);

/*
 * Write a message with this time. Returns its item. NULL, *error 0: not written by ddxlog, or excepted. NULL, *error
 * -errno: writing failed; reported once for each item.
 */
struct replay_item *items_write(struct replay *replay, const struct mcap_message *message, int64_t time, int *error);

/* The least number of readers that an item has. */
int items_readers(const struct replay *replay);

#endif
