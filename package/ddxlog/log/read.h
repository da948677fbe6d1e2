/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Values of one item, from the store into the queue. */
#ifndef DDXLOG_READ_H
#define DDXLOG_READ_H

#include "logger_state.h"

/* Take in what one item has, without waiting. False if the item failed and is not read any more. */
bool item_take(struct logger *logger, struct item *item);
/* What ITEM_FOUND and ITEM_LEAVE ask of the main thread. */
void item_begin(struct logger *logger, struct item *item);
void item_leave(struct item *item);

#endif
