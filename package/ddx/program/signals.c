/* SPDX-License-Identifier: GPL-2.0-or-later */
/* TERM, INT and USR1. After TERM the program exits within five seconds, whatever it waits for. */
#include "signals.h"

#include <signal.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#include "startup.h"

#define TICK_NS 100000000
#define PATIENCE_TICKS 35 /* until waits for other programs (a pipe without a reader) end */
#define LAST_TICK 45      /* until the program exits in any case */

static volatile sig_atomic_t stop_wanted, report_wanted, ticks;
static timer_t ticker;
static FILE *report;

/* A service gets TERM twice, from its script and from `sv`: only the first one interrupts a system call. */
static void on_signal(int number) {
    static const struct itimerspec period = {{0, TICK_NS}, {0, TICK_NS}};
    const struct sigaction again = {.sa_handler = on_signal, .sa_flags = SA_RESTART};

    if (number == SIGUSR1) {
        report_wanted = 1;
    } else {
        if (!stop_wanted)
            timer_settime(ticker, 0, &period, NULL);
        stop_wanted = 1;
        sigaction(SIGTERM, &again, NULL);
        sigaction(SIGINT, &again, NULL);
    }
}

/*
 * Ticks are counted, not the time, so that a stall of the whole machine does not count. From PATIENCE_TICKS on, each
 * tick also interrupts a system call that the main thread waits in.
 */
static void on_tick(int number) {
    struct sigaction action = {.sa_handler = on_tick};

    (void)number;
    ticks++;
    if (ticks == PATIENCE_TICKS)
        sigaction(SIGALRM, &action, NULL);
    if (ticks >= LAST_TICK)
        _exit(EXIT_OK); /* the book in the store shows the unfinished frames */
}

void signals_catch(void) {
    struct sigaction action = {.sa_handler = on_tick, .sa_flags = SA_RESTART};
    struct sigevent tick = {.sigev_notify = SIGEV_SIGNAL, .sigev_signo = SIGALRM};
    sigset_t alarm;

    sigemptyset(&action.sa_mask);
    sigaction(SIGALRM, &action, NULL);
    sigemptyset(&alarm);
    sigaddset(&alarm, SIGALRM);
    sigprocmask(SIG_UNBLOCK, &alarm, NULL);
    timer_create(CLOCK_MONOTONIC, &tick, &ticker);
    action.sa_flags = 0;
    action.sa_handler = on_signal;
    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGUSR1, &action, NULL);
    action.sa_handler = SIG_IGN; /* write() returns an error instead */
    sigaction(SIGPIPE, &action, NULL);
    sigaction(SIGXFSZ, &action, NULL);
}

bool program_stopping(void) {
    return stop_wanted;
}

bool program_has_no_patience(void) {
    return ticks >= PATIENCE_TICKS;
}

void program_report_to(FILE *file) {
    report = file;
}

void program_report(DDX_STATS_BOOK *book) {
    report_wanted = 0;
    ddx_stats_print(book, report ? report : stdout);
}

bool program_report_wanted(void) {
    return report_wanted;
}
