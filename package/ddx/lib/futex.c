/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "futex.h"

#include <errno.h>
#include <limits.h>
#include <linux/futex.h>
#include <stdbool.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "ddx.h"

#define SECOND 1000000000
#define SLICE (SECOND / 50) /* where two words cannot be waited for at once */

#ifndef SYS_futex_waitv
#define SYS_futex_waitv 449 /* the same number on every architecture */
#endif

/* The kernel's own time structure; libc's differs on 32 bits. */
struct kernel_time {
    int64_t seconds, nanoseconds;
};

static bool missing; /* futex_waitv() came with Linux 5.16 */

static void wait_one(const ddx_word *word, uint32_t value, int64_t deadline) {
#ifdef SYS_futex_time64
    long number = SYS_futex_time64;
#else
    long number = SYS_futex;
#endif
    int64_t slice = ddx_time_now() + SLICE;
    int64_t until = deadline < slice ? deadline : slice;
    struct kernel_time time = {until / SECOND, until % SECOND};

    /* BITSET, since its time is absolute: a signal in between does not prolong the wait. */
    syscall(number, word, FUTEX_WAIT_BITSET, value, &time, NULL, FUTEX_BITSET_MATCH_ANY);
}

void ddx_futex_wait(const ddx_word *shared, uint32_t shared_value, const ddx_word *own, uint32_t own_value,
                    int64_t deadline) {
    struct futex_waitv words[2] = {
        {.val = own_value, .uaddr = (uintptr_t)own, .flags = FUTEX_32 | FUTEX_PRIVATE_FLAG},
        {.val = shared_value, .uaddr = (uintptr_t)shared, .flags = FUTEX_32},
    };
    struct kernel_time time = {deadline / SECOND, deadline % SECOND};

    if (!__atomic_load_n(&missing, __ATOMIC_RELAXED)) {
        long result =
            syscall(SYS_futex_waitv, words, shared ? 2 : 1, 0, deadline == DDX_FOREVER ? NULL : &time, CLOCK_MONOTONIC);

        if (result >= 0 || errno != ENOSYS)
            return;
        __atomic_store_n(&missing, true, __ATOMIC_RELAXED);
    }
    if (shared)
        wait_one(shared, shared_value, deadline);
    else
        wait_one(own, own_value, deadline);
}

void ddx_futex_wake(const ddx_word *shared) {
    syscall(SYS_futex, shared, FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
}

void ddx_futex_change(ddx_word *own) {
    atomic_fetch_add(own, 1);
    syscall(SYS_futex, own, FUTEX_WAKE_PRIVATE, INT_MAX, NULL, NULL, 0);
}
