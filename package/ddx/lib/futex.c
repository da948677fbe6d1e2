/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "futex.h"

#include <limits.h>
#include <linux/futex.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "ddx.h"

#define SECOND 1000000000

DDX_HOT DDX_TIME ddx_time_now(void) {
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (DDX_TIME)now.tv_sec * SECOND + now.tv_nsec;
}

/* The kernel's own time structure; libc's differs on 32 bits. */
struct kernel_time {
    int64_t seconds, nanoseconds;
};

DDX_HOT void ddx_futex_wait(const ddx_word *word, uint32_t value, bool shared, int64_t deadline) {
#ifdef SYS_futex_time64
    long number = SYS_futex_time64;
#else
    long number = SYS_futex;
#endif
    struct kernel_time time = {deadline / SECOND, deadline % SECOND};

    /* BITSET, since its timeout is absolute: a signal does not prolong the wait. One word, since futex_waitv() on two
     * costs each reader 2.5 us a frame. */
    syscall(number, word, shared ? FUTEX_WAIT_BITSET : FUTEX_WAIT_BITSET | FUTEX_PRIVATE_FLAG, value,
            deadline == DDX_FOREVER ? NULL : &time, NULL, FUTEX_BITSET_MATCH_ANY);
}

DDX_HOT void ddx_futex_wake(const ddx_word *shared) {
    syscall(SYS_futex, shared, FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
}

void ddx_futex_change(ddx_word *own) {
    atomic_fetch_add(own, 1);
    syscall(SYS_futex, own, FUTEX_WAKE_PRIVATE, INT_MAX, NULL, NULL, 0);
}
