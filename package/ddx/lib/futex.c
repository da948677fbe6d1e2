/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "futex.h"

#include <errno.h>
#include <limits.h>
#include <linux/futex.h>
#include <pthread.h>
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

/* ---- A handle's lock ---- */

#define STEP_NS 50000 /* between attempts on a kernel that cannot lend priorities */

__thread uint32_t ddx_thread_number;

static void forget(void) {
    ddx_thread_number = 0;
}

static void watch_forks(void) {
    pthread_atfork(NULL, NULL, forget);
}

uint32_t ddx_lock_thread(void) {
    static pthread_once_t once = PTHREAD_ONCE_INIT;

    pthread_once(&once, watch_forks);
    return ddx_thread_number = (uint32_t)syscall(SYS_gettid);
}

void ddx_lock_wait(ddx_lock *lock) {
    while (syscall(SYS_futex, lock, FUTEX_LOCK_PI_PRIVATE, 0, NULL, NULL, 0)) {
        struct timespec step = {0, STEP_NS};

        if (errno == EINTR || errno == EAGAIN)
            continue;
        nanosleep(&step, NULL);
        if (ddx_lock_try(lock))
            return;
    }
    /* The kernel made this thread the owner, which is a barrier; this load is for tools that know only C's memory model
     * (ThreadSanitizer). */
    atomic_load_explicit(lock, memory_order_acquire);
}

void ddx_lock_hand_over(ddx_lock *lock) {
    atomic_fetch_or_explicit(lock, 0, memory_order_release); /* likewise */
    syscall(SYS_futex, lock, FUTEX_UNLOCK_PI_PRIVATE, 0, NULL, NULL, 0);
}
