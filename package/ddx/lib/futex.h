/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Waiting: on words in shared memory, with absolute deadlines, and for a handle's lock. And ddx_time_now(). */
#ifndef DDX_FUTEX_H
#define DDX_FUTEX_H

#include <stdbool.h>

#include "layout.h"

/* ---- Words ---- */

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

/*
 * ---- A handle's lock ----
 *
 * The frame path takes it several times for each frame, not in the cache after each sleep, and almost
 * never contended: so the lock is one word beside the data that it guards, and is taken inline. A waiting thread lends
 * its priority to the owner, so that a recorder with real-time priority does not wait for a preempted keeper.
 */

/* 0: free. Else the owner's thread number, and a bit for "others wait" (a PI futex). */
typedef ddx_word ddx_lock;

/* This thread's number, 0 while unknown. */
extern __thread uint32_t ddx_thread_number __attribute__((visibility("hidden"), tls_model("initial-exec")));

/* The rare cases. */
DDX_COLD void ddx_lock_wait(ddx_lock *lock);
DDX_COLD void ddx_lock_hand_over(ddx_lock *lock);
DDX_COLD uint32_t ddx_lock_thread(void);

static inline bool ddx_lock_try(ddx_lock *lock) {
    uint32_t free = 0, self = ddx_thread_number;

    if (!self)
        self = ddx_lock_thread();
    return atomic_compare_exchange_strong_explicit(lock, &free, self, memory_order_acquire, memory_order_relaxed);
}

static inline void ddx_lock_take(ddx_lock *lock) {
    if (!ddx_lock_try(lock))
        ddx_lock_wait(lock);
}

static inline void ddx_lock_give(ddx_lock *lock) {
    uint32_t self = ddx_thread_number;

    if (!atomic_compare_exchange_strong_explicit(lock, &self, 0, memory_order_release, memory_order_relaxed))
        ddx_lock_hand_over(lock);
}

#endif
