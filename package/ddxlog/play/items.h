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
    struct form *form; /* of the item as it is now */
    uint16_t channel;  /* whose layout that is; 0: none */
    bool refused;      /* another program writes it, for example: reported, left out */
};

/* Create all items of the log. How many. */
unsigned items_create(struct replay *replay);
void items_free(struct replay *replay);

/*
 * Write a message as of `time`. NULL and 0: it is none of ours. NULL and -errno: it could not be written (said so, the
 * first time). Else its item.
 */
struct replay_item *items_write(struct replay *replay, const struct mcap_message *message, int64_t time, int *error);

/* The least number of readers that an item has. */
int items_readers(const struct replay *replay);

#endif
