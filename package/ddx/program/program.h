/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What every program does alike: options in the paper's style, signals, messages, exit codes, the counters' JSON
 * line. */
#ifndef DDX_PROGRAM_H
#define DDX_PROGRAM_H

#include <ddx_stats.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

#include "exit_status.h"
#include "signals.h"

/* One line to stderr: "<program>: <message>". */
__attribute__((format(printf, 1, 2))) void say(const char *format, ...);

/* Where there is no program_start(): whose name is before the lines. */
void say_as(const char *name);

enum option_kind { OPTION_FLAG, OPTION_TEXT, OPTION_NUMBER, OPTION_NAME };

/* An option `-name`, also `--name`. Tables end with a NULL name. */
struct option_entry {
    const char *name;
    const char *argument; /* its name in the help text; NULL for OPTION_FLAG */
    const char *help;
    enum option_kind kind;
    void *value;           /* bool *, const char **, long *, const char ** */
    long minimum, maximum; /* OPTION_NUMBER; OPTION_NAME, which an item can have: bytes at most, 0 for DDX_NAME_MAX */
};

struct program {
    const char *name;
    const char *positional; /* name of the one argument, NULL if there is none */
    bool optional;          /* it may be left out */
    const char *purpose;    /* for -help: a sentence or more */
    const char *notes;      /* for -help: after the options; NULL if none */
    const struct option_entry *options;
    bool brief; /* does one thing and ends: nothing to say of signals and counters */
    /* Set by program_start(): */
    const char *argument; /* the positional argument, or NULL */
    const char *instance;
    long port;
    bool check; /* the settings are to be judged, and nothing else done: exit 0 where the program would begin */
    /* Set by program_attach(): */
    bool hidden; /* the store does not show the counters, and does not say how the former program ended */
};

/*
 * Parse the command line (-help, -version, -instance, -store and -check as well as the program's own options), catch
 * the signals. Ends the program after -help and -version (exit 0) and after bad usage (one line, exit 2).
 */
void program_start(struct program *program, int argc, char **argv);

/* Prints the JSON line if USR1 came, and writes the book into the store at least once a second. Call it often. */
void program_tick(DDX_STATS_BOOK *book);

/* Wait until the time (CLOCK_MONOTONIC, ns). False if told to stop. */
bool program_sleep_until(int64_t time, DDX_STATS_BOOK *book);

/*
 * Before a write that may be delayed: wait until every reader of the item has seen the frame that the write
 * replaces. A stopped reader is waited for once, for some seconds; then, after a line, *patient
 * becomes false, and no reader is waited for. False if the program is to stop.
 */
bool program_wait_for_room(const DDX_STORE_ITEM *item, bool *patient, DDX_STATS_BOOK *book);

/*
 * Whether to try once more what failed with `error`, a write of what could as well be written later: when readers held
 * every frame that there is (-ENOBUFS). Waits a moment first, for one of them to be free. False if told to stop.
 */
bool program_try_again(int error, DDX_STATS_BOOK *book);

/*
 * Connect to the store, for as long as it takes: a program may start before the store. Says so once when it has to
 * wait. NULL when told to stop.
 */
DDX_STORE_ID *program_connect(const struct program *program);

/*
 * Whether to go on after `error` (0 or -errno) of creating an item that only shows what a program does: `item` and
 * `suffix` are its name. A line if there was an error. True unless the store is away: any local user can create an
 * item of that name first, and that must not keep a program from its task.
 */
bool program_does_without(const char *item, const char *suffix, int error);

/*
 * Attach the book; false, after a line, if the instance runs already or the store is away. Where the store refuses the
 * item for another reason, the book counts without it, after a line: program->hidden.
 */
bool program_attach(struct program *program, DDX_STATS_BOOK *book, DDX_STORE_ID *id, const char *source);

/*
 * The item, as soon as it exists; one line if that takes time. NULL and errno: EINTR on a request to
 * stop; the store's reason, after a line, if it refuses.
 */
DDX_STORE_ITEM *program_find(DDX_STORE_ID *id, const char *name, DDX_STATS_BOOK *book);

/*
 * The item, even if it does not exist yet: for readers that must not miss its first value. Otherwise as program_find().
 */
DDX_STORE_ITEM *program_await(DDX_STORE_ID *id, const char *name, DDX_STATS_BOOK *book);

/* Prints a line if the item has not been created yet. */
void program_say_awaited(DDX_STORE_ITEM *item, const char *name);

/*
 * A number that is another one each time; no secret. Never waits, as getrandom() does for seconds on a machine that has
 * just started.
 */
uint64_t program_random(void);

/* Set up a condition whose pthread_cond_timedwait() takes CLOCK_MONOTONIC, as ddx_time_now() does: no step wakes it. */
void program_condition(pthread_cond_t *condition);

/* Keep signals away from threads other than the main one: called at the start of such a thread. */
void program_thread_signals(void);

/* The calling thread gives up the real-time priority that the program may have been started with. */
void program_thread_ordinary(void);

#endif
