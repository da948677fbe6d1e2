/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Sleeping on words in shared memory, with absolute deadlines. futex.c also has ddx_time_now(). */
#ifndef DDX_FUTEX_H
#define DDX_FUTEX_H

#include <stdbool.h>

#include "layout.h"

#define DDX_FOREVER INT64_MAX

/*
 * Sleep until the word differs from `value`, a wake-up, or the deadline (ns, CLOCK_MONOTONIC). May return early: the
 * caller checks its condition. `shared`: other processes may wake the sleeper, too.
 */
void ddx_futex_wait(const ddx_word *word, uint32_t value, bool shared, int64_t deadline);

/* Wake all sleepers on a word in shared memory. 0.3 us without sleepers. */
void ddx_futex_wake(const ddx_word *shared);

/* Change a word of this process and wake its sleepers. */
void ddx_futex_change(ddx_word *own);

#endif
