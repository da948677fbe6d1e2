/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* A reader gets a frame: it attaches to the item, waits for the wanted frame, and pins it. With `lock` held. */
#ifndef DDX_READER_H
#define DDX_READER_H

#include "handle.h"

/* Ask the store for memory for this number of frames. */
int ddx_reader_ask(DDX_STORE_ITEM *item, unsigned frames);
/*
 * Wait for a frame according to `tail` and pin it with pin number `pin`. `lock` is released while sleeping. On success
 * frame->slot is pinned in item->reader.term; until then the pin holds the former frame.
 */
int ddx_reader_take(DDX_STORE_ITEM *item, unsigned pin, struct ddx_ring_frame *frame, uint64_t *missed, double timeout,
                    int tail);
/*
 * Wake the reader if it has slept since before the last message. Returns whether it has: then call again soon, since
 * the reader may be about to sleep, and sleeps on the writer's word only.
 */
bool ddx_reader_wake(const DDX_STORE_ITEM *item);

#endif
