/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A handle's lock: one holder at a time, no waiter is forgotten, a waiting thread lends its priority, and a child
 * process is not taken for its parent.
 */
#include <pthread.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "../../package/ddx/lib/futex.h"
#include "check.h"

#define THREADS 4
#define TURNS 100000

static ddx_lock lock;
static uint64_t counter; /* a plain word: ThreadSanitizer sees accesses without the lock */
static atomic_uint refused;

static void nap(long nanoseconds) {
    struct timespec time = {0, nanoseconds};

    nanosleep(&time, NULL);
}

/* Every fourth time only tries to lock, as the keeper does. */
static void *contend(void *unused) {
    for (unsigned i = 0; i < TURNS; i++) {
        if (i % 4 == 3) {
            while (!ddx_lock_try(&lock))
                atomic_fetch_add(&refused, 1);
        } else
            ddx_lock_take(&lock);
        uint64_t before = counter;
        if (i % 1000 == 0)
            nap(1000); /* other threads start to wait */
        counter = before + 1;
        ddx_lock_give(&lock);
    }
    return unused;
}

static void test_alone(void) {
    pthread_t thread[THREADS];

    for (unsigned i = 0; i < THREADS; i++)
        CHECK_EQUAL(pthread_create(&thread[i], NULL, contend, NULL), 0);
    for (unsigned i = 0; i < THREADS; i++)
        CHECK_EQUAL(pthread_join(thread[i], NULL), 0);
    printf("%u attempts refused\n", atomic_load(&refused));
    CHECK_EQUAL(counter, (uint64_t)THREADS * TURNS);
    CHECK_EQUAL(atomic_load(&lock), 0);
}

/* The priority with which the kernel runs a thread; below 0: real time. */
static long priority(pid_t thread) {
    char path[64], text[512] = "";

    snprintf(path, sizeof path, "/proc/self/task/%d/stat", (int)thread);
    FILE *file = fopen(path, "r");
    CHECK(file && fgets(text, sizeof text, file));
    fclose(file);
    char *field = strrchr(text, ')');
    for (unsigned i = 0; i < 16 && field; i++) /* the 18th field; the second ends at the bracket */
        field = strchr(field + 1, ' ');
    CHECK(field);
    return strtol(field, NULL, 10);
}

static void *urgent(void *allowed) {
    struct sched_param parameters = {.sched_priority = 10};

    *(int *)allowed = !pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
    ddx_lock_take(&lock);
    ddx_lock_give(&lock);
    return NULL;
}

static void test_priority(void) {
    pid_t self = (pid_t)syscall(SYS_gettid);
    pthread_t thread;
    int allowed = 0;

    ddx_lock_take(&lock);
    CHECK(priority(self) >= 0);
    CHECK_EQUAL(pthread_create(&thread, NULL, urgent, &allowed), 0);
    for (int i = 0; i < 1000 && (atomic_load(&lock) & ~0x3fffffffu) == 0; i++)
        nap(5000000); /* until the thread waits */
    long lent = priority(self);
    ddx_lock_give(&lock);
    CHECK_EQUAL(pthread_join(thread, NULL), 0);
    printf("priority %ld, %s\n", lent, allowed ? "lent" : "not tested: real time is not allowed here");
    CHECK(!allowed || lent < 0);
    CHECK(priority(self) >= 0);
}

static void test_child(void) {
    int status;

    ddx_lock_take(&lock);
    ddx_lock_give(&lock);
    CHECK_EQUAL(ddx_thread_number, getpid());
    pid_t child = fork();
    if (child == 0) {
        ddx_lock_take(&lock);
        _exit(atomic_load(&lock) == (uint32_t)getpid() ? 0 : 1);
    }
    CHECK_EQUAL(waitpid(child, &status, 0), child);
    CHECK_EQUAL(status, 0);
}

int main(void) {
    test_child();
    test_alone();
    test_priority();
    return 0;
}
