/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Common to all programs: options in the paper's style, signals, messages, exit codes, the counters' JSON line. */
#ifndef DDX_PROGRAM_H
#define DDX_PROGRAM_H

#include <ddx_stats.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

#include "startup.h"

/* One line to stderr: "<program>: <message>". */
__attribute__((format(printf, 1, 2))) void say(const char *format, ...);

/* Set the program name of the lines, in programs without program_start(). */
void say_as(const char *name);

/* Bad usage: one line to stderr, "<program>: <message>; see <program> -help"; exit 2. */
__attribute__((format(printf, 1, 2), noreturn)) void program_bad_usage(const char *format, ...);

enum option_kind { OPTION_FLAG, OPTION_TEXT, OPTION_NUMBER, OPTION_NAME };

/* An option `-name`, also `--name`. Tables end with a NULL name. */
struct option_entry {
    const char *name;
    const char *argument; /* its name in the help text; NULL for OPTION_FLAG */
    const char *help;
    enum option_kind kind;
    void *value;           /* bool *, const char **, long *, const char ** */
    long minimum, maximum; /* of OPTION_NUMBER; of OPTION_NAME (an item's name): most bytes, 0 for DDX_NAME_MAX */
};

struct program {
    const char *name;
    const char *positional; /* name of the positional argument, NULL if there is none */
    bool optional;          /* the positional argument may be omitted */
    const char *purpose;    /* for -help: a sentence or more */
    const char *notes;      /* for -help: after the options; NULL if none */
    const struct option_entry *options;
    bool brief; /* does one thing and exits: -help does not mention signals and counters */
    /* Set by program_start(): */
    const char *argument; /* the positional argument, or NULL */
    const char *instance;
    long port;
    bool check; /* only check the settings: exit 0 where the program would begin its work */
    /* Set by program_attach(): */
    bool hidden; /* the counters are not in the store, so the former program's counters are not known either */
};

/*
 * Parse the command line (-help, -version, -instance, -store and -check as well as the program's own options), and
 * catch the signals. Exits after -help and -version (exit 0) and after bad usage (one line, exit 2).
 */
void program_start(struct program *program, int argc, char **argv);

/* Print the JSON line if USR1 came, and write the book into the store at least once a second. To be called often. */
void program_tick(DDX_STATS_BOOK *book);

/* Wait until the time (CLOCK_MONOTONIC, ns). False on a request to stop. */
bool program_sleep_until(int64_t time, DDX_STATS_BOOK *book);

/*
 * Before a write that may be delayed: wait until every reader of the item has seen the frame that the write
 * replaces. After some seconds without progress (a stopped reader), prints a line and sets *patient to false: from then
 * on it waits for no reader. False on a request to stop.
 */
bool program_wait_for_room(const DDX_STORE_ITEM *item, bool *patient, DDX_STATS_BOOK *book);

/*
 * Whether to try again a write that failed with `error` and may be delayed: if readers held every frame (-ENOBUFS).
 * Waits a moment before, so that a reader can release one. False on a request to stop.
 */
bool program_try_again(int error, DDX_STATS_BOOK *book);

/*
 * Connect to the store, without a time limit: a program may start before the store. Prints one line if it must wait.
 * NULL on a request to stop.
 */
DDX_STORE_ID *program_connect(const struct program *program);

/*
 * Whether to continue after `error` (0 or -errno) of creating an item that only shows the program's state; `item` and
 * `suffix` form its name. Prints a line if there was an error. True unless the store is away: any local user can create
 * an item of that name first, and that must not prevent the program from doing its task.
 */
bool program_does_without(const char *item, const char *suffix, int error);

/* The book of the counters, with these reasons of losses. Where there is no memory for it, exits as on bad usage. */
DDX_STATS_BOOK *program_book(const struct program *program, const char *const *reasons);

/*
 * Attach the book. False, after a line, if the instance runs already or the store is away. If the store refuses the
 * item for another reason, prints a line and sets program->hidden; the book then counts without the store.
 */
bool program_attach(struct program *program, DDX_STATS_BOOK *book, DDX_STORE_ID *id, const char *source);

/*
 * Wait until the item exists, and open it; prints one line if that takes time. NULL and errno: EINTR on a request to
 * stop; the store's reason, after a line, if it refuses.
 */
DDX_STORE_ITEM *program_find(DDX_STORE_ID *id, const char *name, DDX_STATS_BOOK *book);

/* Open the item even before it exists, for readers that must not miss its first value. Otherwise as program_find(). */
DDX_STORE_ITEM *program_await(DDX_STORE_ID *id, const char *name, DDX_STATS_BOOK *book);

/* Print a line if the item has not been created yet. */
void program_say_awaited(DDX_STORE_ITEM *item, const char *name);

/* A number that differs each time; not secret. Never waits, as getrandom() does for seconds on a machine that boots. */
uint64_t program_random(void);

/* Set up a condition whose pthread_cond_timedwait() takes CLOCK_MONOTONIC, so that clock steps do not matter. */
void program_condition(pthread_cond_t *condition);

/* Block signals in a thread other than the main one; to be called at its start. */
void program_thread_signals(void);

/* Give up the real-time priority that the calling thread may have inherited from the program's start. */
void program_thread_ordinary(void);

/* ---- Signals: TERM and INT stop the program, USR1 prints the counters ---- */

/* TERM or INT came: finish within five seconds. If the program still runs then, a timer exits it, with exit 0. */
bool program_stopping(void);

/* The request to stop came more than three seconds ago: do not wait for other programs any more. From any thread. */
bool program_has_no_patience(void);

/* Set the destination of the counters (default: standard output), if standard output has another use. */
void program_report_to(FILE *file);

/* Print the counters' JSON line. */
void program_report(DDX_STATS_BOOK *book);

/* Catch them; program_start() does this. */
void signals_catch(void);

#endif
