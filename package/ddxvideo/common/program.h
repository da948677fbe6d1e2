/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What every program does alike: options in the paper's style, signals, messages, exit codes, the counters' JSON
 * line. */
#ifndef DDXVIDEO_PROGRAM_H
#define DDXVIDEO_PROGRAM_H

#include <ddx_stats.h>
#include <stdbool.h>
#include <stdint.h>

enum { EXIT_OK = 0, EXIT_FAILED = 1, EXIT_USAGE = 2 };

/* One line to stderr: "<program>: <message>". */
__attribute__((format(printf, 1, 2))) void say(const char *format, ...);

enum option_kind { OPTION_FLAG, OPTION_TEXT, OPTION_NUMBER };

/* An option `-name`, also `--name`. Tables end with a NULL name. */
struct option_entry {
    const char *name;
    const char *argument; /* its name in the help text; NULL for OPTION_FLAG */
    const char *help;
    enum option_kind kind;
    void *value;           /* bool *, const char ** or long * */
    long minimum, maximum; /* OPTION_NUMBER */
};

struct program {
    const char *name;
    const char *positional; /* name of the one argument, NULL if there is none */
    const char *purpose;    /* for -help: a sentence or more */
    const char *notes;      /* for -help: behind the options; NULL if none */
    const struct option_entry *options;
    /* Set by program_start(): */
    const char *argument; /* the positional argument, or NULL */
    const char *instance;
    long port;
};

/*
 * Parse the command line (-help, -instance and -store as well as the program's own options), catch the signals.
 * Ends the program after -help (exit 0) and after bad usage (one line, exit 2).
 */
void program_start(struct program *program, int argc, char **argv);

/* TERM or INT came: finish. */
bool program_stopping(void);

/* Prints the JSON line if USR1 came, and writes the book into the store at least once a second. Call it often. */
void program_tick(DDX_STATS_BOOK *book);

/* Wait until the time (CLOCK_MONOTONIC, ns). False if told to stop. */
bool program_sleep_until(int64_t time, DDX_STATS_BOOK *book);

/*
 * Connect to the store, for as long as it takes: a program may start before the store. Says so once when it has to
 * wait. NULL when told to stop.
 */
DDX_STORE_ID *program_connect(const struct program *program);

/* Attach the book; false, after a line, if the instance runs already or the store refuses. */
bool program_attach(const struct program *program, DDX_STATS_BOOK *book, DDX_STORE_ID *id, const char *source);

/* Keep signals away from threads other than the main one: called at the start of such a thread. */
void program_thread_signals(void);

#endif
