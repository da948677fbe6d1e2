/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "program.h"

#include <errno.h>
#include <getopt.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <time.h>
#include <unistd.h>

#include "ddx_time.h"
#include "startup.h"

/* ---- TERM, INT and USR1. After TERM the program exits within five seconds, whatever it waits for ---- */

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

/* USR1 came. */
static bool is_report_wanted(void) {
    return report_wanted;
}

/* ---- Options, messages, the store ---- */

#define PATIENCE (5 * SECOND) /* with readers that do not read */
#define OPTIONS_MAX 24

static const char *program_name = "ddx";

void say_as(const char *name) {
    program_name = name;
}

void say(const char *format, ...) {
    char text[512];
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    fprintf(stderr, "%s: %s\n", program_name, text); /* one call, one line, also between threads */
}

uint64_t program_random(void) {
    uint64_t number = 0;
    struct timespec wall;

    if (getrandom(&number, sizeof number, GRND_INSECURE) < 0)
        number = 0; /* a kernel before 5.6 */
    clock_gettime(CLOCK_REALTIME, &wall);
    return number ^ (uint64_t)ddx_time_now() << 32 ^ (uint64_t)wall.tv_sec ^ (uint64_t)wall.tv_nsec;
}

void program_condition(pthread_cond_t *condition) {
    pthread_condattr_t clock;

    pthread_condattr_init(&clock);
    pthread_condattr_setclock(&clock, CLOCK_MONOTONIC);
    pthread_cond_init(condition, &clock);
    pthread_condattr_destroy(&clock);
}

void program_thread_signals(void) {
    sigset_t all;

    sigfillset(&all);
    pthread_sigmask(SIG_BLOCK, &all, NULL);
}

void program_thread_ordinary(void) {
    const struct sched_param none = {.sched_priority = 0};

    pthread_setschedparam(pthread_self(), SCHED_OTHER, &none);
}

static void help_option(const struct option_entry *entry) {
    char left[40];

    snprintf(left, sizeof left, "-%s%s%s", entry->name, entry->argument ? " " : "",
             entry->argument ? entry->argument : "");
    printf("  %-20s %s\n", left, entry->help);
}

static void help(const struct program *program, const struct option_entry *common) {
    const char *begin = program->optional ? " [" : program->positional ? " " : "";

    printf("usage: %s%s%s%s [options]\n\n%s\n\noptions (-name and --name are the same):\n", program->name, begin,
           program->positional ? program->positional : "", program->optional ? "]" : "", program->purpose);
    for (const struct option_entry *entry = program->options; entry->name; entry++)
        help_option(entry);
    for (const struct option_entry *entry = common; entry->name; entry++)
        help_option(entry);
    printf("\n%s%s", program->notes ? program->notes : "", program->notes ? "\n\n" : "");
    if (!program->brief)
        printf("Signals: TERM and INT stop cleanly; USR1 prints the counters. The counters are one line of JSON on\n"
               "standard output, also printed at exit, and kept in the store as item `<instance>.stats`.\n");
    printf("Exit status: 0 done, 1 failed, 2 bad usage or bad input.\n");
}

void program_bad_usage(const char *format, ...) {
    char text[512];
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    say("%s; see %s -help", text, program_name);
    exit(EXIT_USAGE);
}

/* Checked here: the store would refuse the name later, with a different message. */
static void check_name(const struct option_entry *entry, const char *text) {
    long most = entry->maximum ? entry->maximum : DDX_NAME_MAX;

    if ((long)strlen(text) > most)
        program_bad_usage("-%s %s: a name of at most %ld bytes is needed", entry->name, text, most);
    for (const char *c = text; *c; c++)
        if (*c <= ' ' || *c > '~' || *c == '/')
            program_bad_usage("-%s %s: a name without blanks and slashes, in ASCII, is needed", entry->name, text);
}

static void set_option(const struct option_entry *entry, const char *text) {
    switch (entry->kind) {
    case OPTION_FLAG: *(bool *)entry->value = true; break;
    case OPTION_NAME: check_name(entry, text); /* fall through */
    case OPTION_TEXT:
        if (!*text)
            program_bad_usage("-%s is empty", entry->name);
        *(const char **)entry->value = text;
        break;
    case OPTION_NUMBER: {
        char *end;
        errno = 0;
        long number = strtol(text, &end, 10);
        bool whole = !errno && end != text && (unsigned char)*text > ' ' && !*end;
        if (!whole || number < entry->minimum || number > entry->maximum)
            program_bad_usage("-%s %s: a number from %ld to %ld is needed", entry->name, text, entry->minimum,
                              entry->maximum);
        *(long *)entry->value = number;
        break;
    }
    }
}

void program_start(struct program *program, int argc, char **argv) {
    bool wants_help = false, wants_version = false;
    const struct option_entry common[] = {
        {"instance", "NAME", "name of this instance and of its stats item (default: the program's)", OPTION_NAME,
         &program->instance, 0, DDX_NAME_MAX - (long)sizeof ".counters" + 1},
        {"store", "PORT", "port of the store", OPTION_NUMBER, &program->port, 0, 65535},
        {"check", NULL, "only check the options: exit 0 or 2", OPTION_FLAG, &program->check, 0, 0},
        {"version", NULL, "print the version", OPTION_FLAG, &wants_version, 0, 0},
        {"help", NULL, "this text", OPTION_FLAG, &wants_help, 0, 0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };
    const struct option_entry *entries[OPTIONS_MAX];
    struct option options[OPTIONS_MAX + 1] = {{NULL, 0, NULL, 0}};
    int count = 0;

    for (const struct option_entry *entry = program->options; entry->name && count < OPTIONS_MAX; entry++)
        entries[count++] = entry;
    for (const struct option_entry *entry = common; entry->name && count < OPTIONS_MAX; entry++)
        entries[count++] = entry;
    for (int i = 0; i < count; i++) {
        options[i].name = entries[i]->name;
        options[i].has_arg = entries[i]->argument ? required_argument : no_argument;
    }

    descriptors_open();
    program_name = program->name;
    program->instance = program->name;
    opterr = 0;
    for (;;) {
        int index = -1, at = optind;
        int found = getopt_long_only(argc, argv, ":", options, &index);

        if (found == -1)
            break;
        if (found == ':')
            program_bad_usage("%s needs a value", argv[optind - 1]);
        if (found || index < 0)
            program_bad_usage("unknown option %s", argv[optind > at ? optind - 1 : at]);
        set_option(entries[index], optarg ? optarg : "");
    }
    if (wants_help) {
        help(program, common);
        exit(EXIT_OK);
    }
    if (wants_version) {
        version_print(program->name);
        exit(EXIT_OK);
    }
    if (optind < argc && program->positional)
        program->argument = argv[optind++];
    if (optind < argc)
        program_bad_usage("unexpected argument %s", argv[optind]);
    if (program->positional && !program->argument && !program->optional)
        program_bad_usage("%s is missing", program->positional);
    signals_catch();
}

void program_tick(DDX_STATS_BOOK *book) {
    static int64_t written;

    if (is_report_wanted())
        program_report(book);
    int64_t now = ddx_time_now();
    if (now - written >= SECOND) {
        written = now;
        ddx_stats_write(book);
    }
}

bool program_sleep_until(int64_t time, DDX_STATS_BOOK *book) {
    /* In slices, since a signal just before the sleep would not interrupt it. The end is exact: it is absolute. */
    for (;;) {
        if (program_stopping())
            return false;
        program_tick(book);
        int64_t now = ddx_time_now();
        if (now >= time)
            return true;
        int64_t until = time - now > SECOND / 5 ? now + SECOND / 5 : time;
        struct timespec deadline = {.tv_sec = (time_t)(until / SECOND), .tv_nsec = (long)(until % SECOND)};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, NULL);
    }
}

bool program_wait_for_room(const DDX_STORE_ITEM *item, bool *patient, DDX_STATS_BOOK *book) {
    int64_t begin = ddx_time_now();

    while (*patient && ddx_store_outruns(item) == 1) {
        if (ddx_time_now() - begin > PATIENCE) {
            say("%s: a reader is stopped, or reads rarely: this program no longer waits for it",
                ddx_store_item_name(item));
            *patient = false;
        } else if (!program_sleep_until(ddx_time_now() + SECOND / 1000, book)) {
            return false;
        }
    }
    return true;
}

bool program_try_again(int error, DDX_STATS_BOOK *book) {
    return error == -ENOBUFS && program_sleep_until(ddx_time_now() + SECOND / 200, book);
}

DDX_STORE_ID *program_connect(const struct program *program) {
    bool said = false;

    while (!program_stopping()) {
        DDX_STORE_ID *id = ddx_store_open(NULL, (int)program->port, 0.5);

        if (id)
            return id;
        if (!said)
            say("%s, waiting for it", ddx_error_text(-errno));
        said = true;
    }
    return NULL;
}

DDX_STORE_ITEM *program_await(DDX_STORE_ID *id, const char *name, DDX_STATS_BOOK *book) {
    for (;;) {
        DDX_STORE_ITEM *item = ddx_store_await_item(id, name);

        if (item)
            return item;
        int error = errno;
        if (error != ECONNREFUSED)
            say("%s: %s", name, ddx_error_text(-error));
        if (error != ECONNREFUSED || !program_sleep_until(ddx_time_now() + SECOND / 50, book)) {
            errno = error == ECONNREFUSED ? EINTR : error;
            return NULL;
        }
    }
}

void program_say_awaited(DDX_STORE_ITEM *item, const char *name) {
    struct ddx_item_info info;

    if (!ddx_store_item_info(item, &info) && !*info.type)
        say("waiting for %s: %s", name, ddx_error_text(-ENOENT));
}

DDX_STORE_ITEM *program_find(DDX_STORE_ID *id, const char *name, DDX_STATS_BOOK *book) {
    bool said = false;
    int64_t begin = ddx_time_now();

    for (;;) {
        DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, NULL, 0);

        if (item)
            return item;
        int error = errno;
        bool failed = error != ENOENT && error != ECONNREFUSED;
        if (failed || (!said && ddx_time_now() - begin > SECOND)) {
            say("%s%s: %s", failed ? "" : "waiting for ", name, ddx_error_text(-error));
            said = true;
        }
        if (failed || !program_sleep_until(ddx_time_now() + SECOND / 50, book)) {
            errno = failed ? error : EINTR;
            return NULL;
        }
    }
}

bool program_does_without(const char *item, const char *suffix, int error) {
    bool away = error == -ECONNREFUSED || error == -ETIMEDOUT;

    if (error)
        say("%s%s: %s%s", item, suffix, ddx_error_text(error), away ? "" : "; going on without it");
    return !away;
}

DDX_STATS_BOOK *program_book(const struct program *program, const char *const *reasons) {
    DDX_STATS_BOOK *book = ddx_stats_open(program->instance, reasons);

    if (!book)
        program_bad_usage("-instance %s: %s", program->instance, ddx_error_text(-errno));
    return book;
}

bool program_attach(struct program *program, DDX_STATS_BOOK *book, DDX_STORE_ID *id, const char *source) {
    int error = ddx_stats_attach(book, id, source);

    program->hidden = error;
    if (error == -EEXIST)
        say("an instance %s runs already; give this one another name with -instance", program->instance);
    return error != -EEXIST && program_does_without(program->instance, ".stats", error);
}
