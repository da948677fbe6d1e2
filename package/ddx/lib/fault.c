/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Kills or stops the program at a point of fault.h. Only in the tests' copies of library and store. */
#include "fault.h"

#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#define SLOW_NS 20000000
#define PLANS 4

#define NAME(name, text) text,
const char *const ddx_point_name[DDX_POINT_COUNT] = {DDX_POINTS(NAME)};

static struct plan {
    enum ddx_point point;
    uint64_t nth;
    int signal; /* 0: slow */
    bool quiet, with_holder;
    _Atomic(uint64_t) passed;
} plans[PLANS];
static unsigned plan_count;
static struct ddx_fault_journal *journal;
int ddx_fault_holder;
static pthread_once_t once = PTHREAD_ONCE_INIT;

static void refuse(const char *text) {
    fprintf(stderr, "DDX_FAULT: %s: cannot be understood\n", text);
    abort();
}

static void add_plan(const char *text) {
    char name[32], what[8];
    unsigned long long nth;

    if (plan_count == PLANS || sscanf(text, "%31[^:]:%llu:%7s", name, &nth, what) != 3)
        refuse(text);
    struct plan *plan = &plans[plan_count++];
    while (plan->point < DDX_POINT_COUNT && strcmp(ddx_point_name[plan->point], name) != 0)
        plan->point++;
    plan->nth = nth;
    plan->quiet = !strcmp(what, "die");
    plan->with_holder = plan->quiet || !strcmp(what, "end");
    plan->signal = plan->with_holder || !strcmp(what, "kill") ? SIGKILL : !strcmp(what, "stop") ? SIGSTOP : 0;
    if (plan->point == DDX_POINT_COUNT || (!plan->signal && strcmp(what, "slow") != 0))
        refuse(text);
}

static void prepare(void) {
    const char *path = getenv("DDX_FAULT_JOURNAL"), *wanted = getenv("DDX_FAULT");
    char *copy = strdup(wanted ? wanted : ""), *rest = copy;

    for (char *text; (text = strsep(&rest, ",")) != NULL;)
        if (*text)
            add_plan(text);
    free(copy);
    int fd = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
    if (fd < 0)
        return;
    journal = mmap(NULL, sizeof *journal, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (journal == MAP_FAILED)
        abort();
    close(fd);
}

static int64_t clock_now(void) {
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static void strike(const struct plan *plan) {
    if (!plan->signal) {
        nanosleep(&(struct timespec){0, SLOW_NS}, NULL);
        return;
    }
    if (journal && !plan->quiet) {
        journal->point = plan->point;
        journal->pid = (int32_t)getpid();
        journal->time = clock_now();
        journal->struck++;
    }
    if (plan->with_holder && ddx_fault_holder)
        kill(ddx_fault_holder, SIGKILL);
    raise(plan->signal); /* not kill(): this thread must not run on */
}

void ddx_fault_pass(enum ddx_point point) {
    pthread_once(&once, prepare);
    if (journal) {
        journal->at[point] = clock_now(); /* before the count: a program that waits for the count may read the time */
        journal->passed[point]++;
    }
    for (unsigned i = 0; i < plan_count; i++) {
        uint64_t count = plans[i].point == point ? ++plans[i].passed : 0;

        if (count && (count == plans[i].nth || (!plans[i].signal && count > plans[i].nth)))
            strike(&plans[i]);
    }
}
