/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "holder.h"

#include <errno.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <ddx.h>

#include "../lib/fault.h"
#include "note.h"

/*
 * Seconds without a beat, as the holder counts them: it must have run in each. Clients give up what they ask after
 * five, and then ddxhealth starts the whole store anew; the next worker has to answer before that.
 */
#define HUNG 3
#define PATIENCE 2       /* seconds that a worker gets to end */
#define STRIKES 3        /* workers that one client may cost */
#define HASTE 20         /* workers within a second; then it takes its time */
#define REST 100000000   /* ns */

/* What holder and workers tell each other; a test that is its own worker has no holder. */
static struct watch {
    _Atomic(uint32_t) beats;
    _Atomic(int32_t) serving; /* socket plus one, 0: none */
    int32_t banned;
    uint32_t restarts;
} nobody, *watch = &nobody;

void holder_beat(void) {
    watch->beats++;
}

void holder_serving(int socket) {
    atomic_store(&watch->serving, socket + 1);
}

int holder_banned(void) {
    return watch->banned - 1;
}

unsigned holder_restarts(void) {
    return watch->restarts;
}

static pid_t start(int (*work)(void)) {
    pid_t holder = getpid();
    /* As fork(), but for the table of descriptors, which no call of the C library shares. */
    pid_t pid = (pid_t)syscall(SYS_clone, CLONE_FILES | SIGCHLD, NULL, NULL, NULL, NULL);

    if (pid)
        return pid;
    prctl(PR_SET_PDEATHSIG, SIGKILL); /* without a holder nobody would keep what this one does */
    prctl(PR_SET_NAME, "store-worker");
    if (getppid() != holder)
        _exit(1);
#ifdef DDX_FAULTS
    ddx_fault_holder = holder;
#endif
    exit(work());
}

/* Who made it die? */
static void blame(void) {
    static int32_t last, strikes;
    int32_t served = atomic_exchange(&watch->serving, 0);

    strikes = served && served == last ? strikes + 1 : 1;
    last = served;
    watch->banned = served && strikes >= STRIKES ? served : 0;
}

/* One that dies as soon as it begins must not take all of the processor. */
static void slow_down(void) {
    static int64_t since;
    static unsigned count;

    if (ddx_time_now() - since > 1000000000) {
        since = ddx_time_now();
        count = 0;
    }
    if (++count > HASTE)
        nanosleep(&(struct timespec){0, REST}, NULL);
}

static void end(pid_t worker) {
    sigset_t child;

    sigemptyset(&child);
    sigaddset(&child, SIGCHLD);
    kill(worker, SIGTERM);
    kill(worker, SIGCONT);
    for (int i = 0; i < PATIENCE; i++) {
        if (waitpid(worker, NULL, WNOHANG) == worker)
            return;
        sigtimedwait(&child, NULL, &(struct timespec){1, 0});
    }
    kill(worker, SIGKILL);
    waitpid(worker, NULL, 0);
}

/* False: it is dead. */
static bool still_there(pid_t worker) {
    int status;

    if (waitpid(worker, &status, WNOHANG) != worker)
        return true;
    if (WIFSIGNALED(status))
        note("the worker was ended by signal %d; another one goes on", WTERMSIG(status));
    else
        note("the worker ended with status %d; another one goes on", WEXITSTATUS(status));
    return false;
}

int holder_run(int (*work)(void)) {
    sigset_t signals;
    unsigned silent = 0;
    pid_t worker;

    watch = mmap(NULL, sizeof *watch, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (watch == MAP_FAILED) {
        note("no memory");
        return 1;
    }
    sigemptyset(&signals);
    sigaddset(&signals, SIGCHLD);
    sigaddset(&signals, SIGTERM);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGUSR1);
    sigprocmask(SIG_BLOCK, &signals, NULL);
    while ((worker = start(work)) >= 0) {
        uint32_t beats = watch->beats;

        for (silent = 0; still_there(worker);) {
            int signal = sigtimedwait(&signals, NULL, &(struct timespec){1, 0});

            if (signal == SIGTERM || signal == SIGINT) {
                end(worker);
                return 0;
            }
            if (signal == SIGUSR1)
                kill(worker, SIGUSR1);
            if (signal >= 0 || errno != EAGAIN)
                continue;
            silent = watch->beats == beats ? silent + 1 : 0;
            beats = watch->beats;
            if (silent == HUNG) {
                note("the worker hangs");
                kill(worker, SIGKILL);
            }
        }
        blame();
        slow_down();
#ifdef DDX_FAULTS
        unsetenv("DDX_FAULT"); /* a test has planned one death, not that of each */
#endif
        watch->restarts++;
    }
    note("no worker: %s", strerror(errno));
    return 1;
}
