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
#include "log.h"

/*
 * Time without a beat, by the clock. At most LOOK_NS counts between two checks, since a holder that was stopped cannot
 * know whether its worker was stopped too. Clients give up a request after five seconds, and then ddxhealth restarts
 * the whole store; the next worker must answer before that.
 */
#define HUNG_NS INT64_C(3000000000)
#define LOOK_NS INT64_C(1000000000)
#define PATIENCE_NS INT64_C(2000000000) /* that a worker gets to exit */
#define STRIKES_MOST 3                  /* workers that one client may kill */
#define WORKERS_A_SECOND 20             /* workers within a second without a pause */
#define REST_NS 100000000               /* of that pause */

/* Shared by holder and workers; a test that is its own worker has no holder. */
static struct watch {
    _Atomic(uint32_t) beats;
    _Atomic(int32_t) serving; /* socket plus one, 0: none */
    int32_t banned;
    uint32_t restarts;
} unwatched, *watch = &unwatched;

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
    /* As fork(), but with a shared descriptor table, which the C library does not offer. */
    pid_t pid = (pid_t)syscall(SYS_clone, CLONE_FILES | SIGCHLD, NULL, NULL, NULL, NULL);

    if (pid)
        return pid;
    prctl(PR_SET_PDEATHSIG, SIGKILL); /* without a holder the worker's state would be lost */
    prctl(PR_SET_NAME, "ddxstore-worker");
    if (getppid() != holder)
        _exit(1);
#ifdef DDX_FAULTS
    ddx_fault_holder = holder;
#endif
    exit(work());
}

/* Count the death against the client whose request was being handled. */
static void blame(void) {
    static int32_t last, strikes;
    int32_t served = atomic_exchange(&watch->serving, 0);

    strikes = served && served == last ? strikes + 1 : 1;
    last = served;
    watch->banned = served && strikes >= STRIKES_MOST ? served : 0;
}

/* Workers that die as soon as they begin must not take all processor time. */
static void slow_down(void) {
    static int64_t since;
    static unsigned count;

    if (ddx_time_now() - since > 1000000000) {
        since = ddx_time_now();
        count = 0;
    }
    if (++count > WORKERS_A_SECOND)
        nanosleep(&(struct timespec){0, REST_NS}, NULL);
}

static void end(pid_t worker) {
    sigset_t child;

    sigemptyset(&child);
    sigaddset(&child, SIGCHLD);
    kill(worker, SIGTERM);
    kill(worker, SIGCONT);
    for (int64_t now, deadline = ddx_time_now() + PATIENCE_NS; (now = ddx_time_now()) < deadline;) {
        if (waitpid(worker, NULL, WNOHANG) == worker)
            return;
        /* The first SIGCHLD may only report that the worker continues. */
        sigtimedwait(&child, NULL, &(struct timespec){(deadline - now) / 1000000000, (deadline - now) % 1000000000});
    }
    kill(worker, SIGKILL);
    waitpid(worker, NULL, 0);
}

/* False: the worker is dead; logs how it died. */
static bool is_alive(pid_t worker) {
    int status;

    if (waitpid(worker, &status, WNOHANG) != worker)
        return true;
    if (WIFSIGNALED(status))
        log_line("the worker was killed by signal %d; the next one continues", WTERMSIG(status));
    else
        log_line("the worker exited with status %d; the next one continues", WEXITSTATUS(status));
    return false;
}

struct silence {
    uint32_t beats; /* at the last check */
    int64_t looked, lasted;
};

/* True once for each silence, however often signals wake the holder. */
static bool is_hanging(struct silence *silence) {
    int64_t now = ddx_time_now(), passed = now - silence->looked;
    uint32_t beats = watch->beats;

    silence->lasted = beats == silence->beats ? silence->lasted + (passed < LOOK_NS ? passed : LOOK_NS) : 0;
    silence->beats = beats;
    silence->looked = now;
    if (silence->lasted < HUNG_NS)
        return false;
    silence->lasted = 0;
    return true;
}

int holder_run(int (*work)(void)) {
    sigset_t signals;
    pid_t worker;

    watch = mmap(NULL, sizeof *watch, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (watch == MAP_FAILED) {
        log_line("no memory");
        return 1;
    }
    sigemptyset(&signals);
    sigaddset(&signals, SIGCHLD);
    sigaddset(&signals, SIGTERM);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGUSR1);
    sigprocmask(SIG_BLOCK, &signals, NULL);
    while ((worker = start(work)) >= 0) {
        struct silence silence = {.beats = watch->beats, .looked = ddx_time_now()};

        while (is_alive(worker)) {
            int signal = sigtimedwait(&signals, NULL, &(struct timespec){1, 0});

            if (signal == SIGTERM || signal == SIGINT) {
                end(worker);
                return 0;
            }
            if (signal == SIGUSR1)
                kill(worker, SIGUSR1);
            if (is_hanging(&silence)) {
                log_line("the worker hangs");
                kill(worker, SIGKILL);
            }
        }
        blame();
        slow_down();
#ifdef DDX_FAULTS
        unsetenv("DDX_FAULT"); /* the fault is for the first worker only */
#endif
        watch->restarts++;
    }
    log_line("no worker: %s", strerror(errno));
    return 1;
}
