/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The thread that keeps files ready. */
#ifndef DDXVIDEO_POOL_PREPARE_H
#define DDXVIDEO_POOL_PREPARE_H

#include "pool_state.h"

/*
 * Start a thread that recovers, and then keeps files ready; it prepares files while `busy`, which it calls, returns
 * false. pool_take() waits for the recovery. 0 or -errno.
 */
int pool_prepare(struct pool *pool, bool (*busy)(void *argument), void *argument);

/* The recording's rate in bytes a second: files are prepared at twice this rate, so as not to disturb it. 0: none. */
void pool_recorded_at(struct pool *pool, uint64_t rate);

/* How many files are ready and free. */
unsigned pool_ready(struct pool *pool);

#endif
