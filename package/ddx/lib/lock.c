/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "lock.h"

#include <errno.h>
#include <linux/futex.h>
#include <pthread.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define STEP 50000 /* ns between attempts on a kernel that cannot lend priorities */

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
        struct timespec step = {0, STEP};

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
