/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Sleeping on words in shared memory, with absolute deadlines. */
#ifndef DDX_FUTEX_H
#define DDX_FUTEX_H

#include "layout.h"

#define DDX_FOREVER INT64_MAX

/*
 * Sleep until `shared` is no longer `shared_value`, or `own` (a word of this process) no longer `own_value`, or
 * somebody wakes one of them, or the deadline (ns, CLOCK_MONOTONIC). `shared` may be NULL. May return early: the caller
 * looks.
 */
void ddx_futex_wait(const ddx_word *shared, uint32_t shared_value, const ddx_word *own, uint32_t own_value,
                    int64_t deadline);

/* Wake all sleepers on a word in shared memory. 0.3 us when nobody sleeps. */
void ddx_futex_wake(const ddx_word *shared);

/* Change a word of this process and wake its sleepers. */
void ddx_futex_change(ddx_word *own);

#endif
