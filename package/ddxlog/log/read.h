/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Values of one item, from the store into the queue. */
#ifndef DDXLOG_READ_H
#define DDXLOG_READ_H

#include "logger_state.h"

/* Queue the new values of one item, without waiting. False if reading failed, so that the item must be closed. */
bool item_take(struct logger *logger, struct item *item);
/* The main thread's work for ITEM_FOUND and ITEM_LEAVE. */
void item_begin(struct logger *logger, struct item *item);
void item_leave(struct item *item);

#endif
