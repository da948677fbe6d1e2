/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* A reader gets a frame: it asks the store to be let in, waits for what it wants, and pins it. With `lock` held. */
#ifndef DDX_READER_TAKE_H
#define DDX_READER_TAKE_H

#include "handle.h"

/* Ask for memory for that number of frames. */
int ddx_reader_ask(DDX_STORE_ITEM *item, unsigned frames);
/*
 * Wait for a frame as `tail` says and pin it with pin number `pin`. `lock` is given up while sleeping. On success
 * frame->slot is pinned in item->reader.term. What the pin held before stays held until then.
 */
int ddx_reader_take(DDX_STORE_ITEM *item, unsigned pin, struct ddx_ring_frame *frame, uint64_t *missed, double timeout,
                    int tail);
/*
 * Is the reader asleep since before the news? Then wake it, and ask again soon: it may be just about to fall asleep,
 * and it sleeps on one word only, which is the writer's.
 */
bool ddx_reader_wake(const DDX_STORE_ITEM *item);

#endif
