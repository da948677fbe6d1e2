/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * A handle's lock. The frame path takes it several times for each frame, cold after each sleep, and almost never finds
 * it taken: so it is one word beside what it guards, and a few instructions where it is used. A thread that has to wait
 * lends its priority to the one it waits for: a recorder with real-time priority must not wait for a keeper that was
 * preempted.
 */
#ifndef DDX_LOCK_H
#define DDX_LOCK_H

#include <stdbool.h>

#include "layout.h"

/* 0: free. Else its owner's thread number, and a bit for "others wait", as the kernel has it. */
typedef ddx_word ddx_lock;

/* This thread's number, 0 while unknown. */
extern __thread uint32_t ddx_thread_number __attribute__((visibility("hidden"), tls_model("initial-exec")));

/* lock.c: what is rare. */
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
