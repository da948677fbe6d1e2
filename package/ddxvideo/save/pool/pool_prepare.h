/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The thread that keeps files ready. */
#ifndef DDXVIDEO_POOL_PREPARE_H
#define DDXVIDEO_POOL_PREPARE_H

#include "pool_state.h"

/*
 * Recover, and then keep files ready, in a thread of its own, which prepares files while `busy` (called from there)
 * returns false. Taking a file waits for the recovery. 0 or -errno.
 */
int pool_prepare(struct pool *pool, bool (*busy)(void *argument), void *argument);

/* The recording's rate in bytes a second: files are prepared at twice this rate, so as not to disturb it. 0: none. */
void pool_recorded_at(struct pool *pool, uint64_t rate);

/* How many files are ready, and free for anybody. Opens nothing. */
unsigned pool_ready(struct pool *pool);

#endif
