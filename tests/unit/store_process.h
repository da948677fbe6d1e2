/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A store for one test, in its own folder. */
#ifndef STORE_PROCESS_H
#define STORE_PROCESS_H

#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "../scratch.h"
#include "../worker_of.h"
#include "check.h"
#include "ddx.h"

static pid_t store_pid;

static inline void store_folder_make(void) {
    scratch_make();
    CHECK_EQUAL(setenv("DDX_DIR", scratch_folder, 1), 0);
}

/* Starts a store with at most this number of descriptors; 0: as many as this program may have. */
static inline void store_start_with(const char *budget, rlim_t descriptors) {
    const char *program = getenv("DDX_STORE_PROGRAM");

    CHECK(program);
    store_pid = fork();
    CHECK(store_pid >= 0);
    if (store_pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL); /* also when a check fails */
        if (descriptors && setrlimit(RLIMIT_NOFILE, &(struct rlimit){descriptors, descriptors}))
            _exit(127);
        execl(program, program, "-m", budget, (char *)NULL);
        _exit(127);
    }
}

/* The program under test is named by the environment, as meson sets it. */
static inline void store_start(const char *budget) {
    store_start_with(budget, 0);
}

/* The worker dies a moment after the holder: the port's lock is free when both are dead. */
static inline void store_stop(int number) {
    char *path = scratch_path("store-2005.lock");

    CHECK_EQUAL(kill(store_pid, number), 0);
    CHECK_EQUAL(waitpid(store_pid, NULL, 0), store_pid);
    int lock = open(path, O_RDWR | O_CLOEXEC);
    free(path);
    CHECK(lock >= 0);
    CHECK_EQUAL(flock(lock, LOCK_EX), 0);
    close(lock);
}

/* 0: there is none now. */
static inline pid_t store_worker(void) {
    return worker_of(store_pid);
}

/* How often the store's worker has slept. */
static inline unsigned long store_sleeps(void) {
    char path[64], line[128];
    unsigned long found = 0;

    snprintf(path, sizeof path, "/proc/%d/status", (int)store_worker());
    FILE *file = fopen(path, "re");
    CHECK(file);
    while (fgets(line, sizeof line, file) && sscanf(line, "voluntary_ctxt_switches: %lu", &found) != 1)
        continue;
    fclose(file);
    return found;
}

/* Sends the signal to both processes of the store. */
static inline void store_signal(int number) {
    CHECK_EQUAL(kill(store_pid, number), 0);
    pid_t worker = store_worker();
    CHECK(!worker || !kill(worker, number));
}

#endif
