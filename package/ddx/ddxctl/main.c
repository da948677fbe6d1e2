/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxctl: inspect and control the store from a shell. */
#include <dirent.h>
#include <errno.h>
#include <getopt.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "../program/startup.h"
#include "ddx_stats.h"
#include "ddxctl.h"

/* ---- The counters of programs ---- */

#define SUFFIX ".stats"
#define TYPE "DDX_STATS"
#define PACKETS ".packets"

/* Any program can write the counters' item: print no control characters. */
static void print_text(const char *text, size_t length) {
    for (size_t i = 0; i < length && text[i]; i++)
        putchar(text[i] < ' ' || text[i] > '~' ? '?' : text[i]);
}

static void print_line(const DDX_STATS *stats, const char *instance) {
    uint64_t lost = 0;

    for (unsigned i = 0; i < DDX_STATS_REASONS && i < stats->reasons; i++)
        lost += stats->lost[i].frames;
    printf("%-24s in %llu, out %llu, waiting %llu, lost %llu", instance, (unsigned long long)stats->in,
           (unsigned long long)stats->out, (unsigned long long)stats->waiting, (unsigned long long)lost);
    for (unsigned i = 0; i < DDX_STATS_REASONS && i < stats->reasons; i++)
        if (stats->lost[i].frames) {
            printf(" (");
            print_text(stats->lost[i].name, sizeof stats->lost[i].name);
            printf(" %llu)", (unsigned long long)stats->lost[i].frames);
        }
    if (stats->skipped)
        printf(", skipped %llu", (unsigned long long)stats->skipped);
    printf(", %s us p50 %llu, p99 %llu, max %llu, starts %u%s",
           stats->latency_until == DDX_STATS_DISK ? "until on disk" : "latency",
           (unsigned long long)ddx_stats_percentile(stats, 0.5), (unsigned long long)ddx_stats_percentile(stats, 0.99),
           (unsigned long long)stats->latency_max, (unsigned)stats->starts, stats->running ? "" : ", stopped");
}

/* One program's counters. The handles remain open between repetitions, so that reading again costs only a copy. */
struct book {
    char name[DDX_NAME_MAX + 1];
    DDX_STORE_ITEM *item;
    DDX_STORE_ITEM *packets; /* a sender's packet counters; or NULL */
    DDX_STATS stats;
    int result;
};

/* Fields of `<instance>.packets` that are shown too, in text with these words around them. */
static const struct {
    const char *field, *before, *after;
    bool tenths;
} rates[] = {{"wire_kbit", "wire", " kbit/s", false},      {"repair_percent", "repair", " %", false},
             {"video_kbit", "video", " kbit/s", false},    {"repair_kbit", "repair", " kbit/s", false},
             {"loss_percent", "loss", " %", false},        {"run_tenths", "runs of", "", true},
             {"freeze_ms", "longest freeze", " ms", false}};

static struct book *books;
static unsigned book_count;

static bool is_book(const struct ddx_item_info *info) {
    size_t length = strlen(info->name);

    return length > strlen(SUFFIX) && !strcmp(info->name + length - strlen(SUFFIX), SUFFIX) &&
           !strcmp(info->type, TYPE);
}

/* A sender may create its packet counters later than its book. */
static void find_packets(DDX_STORE_ID *id, struct book *book) {
    char name[DDX_NAME_MAX + 1];
    int length = (int)(strlen(book->name) - strlen(SUFFIX));

    if (!book->packets && snprintf(name, sizeof name, "%.*s" PACKETS, length, book->name) < (int)sizeof name)
        book->packets = ddx_store_lookup_item(id, name, NULL, 0);
}

static struct book *find_book(const char *name) {
    for (unsigned i = 0; i < book_count; i++)
        if (!strcmp(books[i].name, name))
            return &books[i];
    return NULL;
}

static int open_book(DDX_STORE_ID *id, const char *name) {
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, NULL, 0);
    struct book *more;

    if (!item)
        return errno == ENOENT ? 0 : -errno; /* dropped since the list was made */
    if (strcmp(ddx_store_item_type(item), TYPE) != 0) {
        ddx_store_done_item(item); /* another item has the name since then */
        return 0;
    }
    more = realloc(books, (book_count + 1) * sizeof *books);
    if (!more)
        return -ENOMEM;
    books = more;
    books[book_count] = (struct book){.item = item};
    strcpy(books[book_count++].name, name);
    return 0;
}

static void close_book(unsigned index) {
    ddx_store_done_item(books[index].item);
    ddx_store_done_item(books[index].packets);
    memmove(&books[index], &books[index + 1], (--book_count - index) * sizeof *books);
}

/* Open handles on new books, and close those of dropped ones. */
static int follow(DDX_STORE_ID *id, const struct ddx_item_info *items, unsigned count) {
    int result = 0;

    for (unsigned i = book_count; i-- > 0;) {
        unsigned k = 0;

        while (k < count && strcmp(items[k].name, books[i].name) != 0)
            k++;
        if (k == count)
            close_book(i);
    }
    for (unsigned i = 0; i < count && !result; i++)
        if (is_book(&items[i]) && !find_book(items[i].name))
            result = open_book(id, items[i].name);
    return result;
}

static int by_name(const void *a, const void *b) {
    return strcmp(((const struct book *)a)->name, ((const struct book *)b)->name);
}

static const uint64_t *number_of(const DDX_STORE_ITEM *item, const struct ddx_frame *frame, const char *name) {
    const struct ddx_field *field = ddx_store_field_named(item, name);

    if (!field || field->kind != DDX_KIND_UNSIGNED || field->bytes != sizeof(uint64_t) || field->count != 1)
        return NULL;
    return (const uint64_t *)((const char *)frame->data + field->offset);
}

/* The present rates and losses of a stream and its link. */
static void print_rates(DDX_STORE_ITEM *packets, bool json) {
    struct ddx_frame frame;

    if (!packets || ddx_store_acquire(packets, &frame, 0, DDX_CURRENT))
        return;
    for (unsigned i = 0; i < sizeof rates / sizeof *rates; i++) {
        const uint64_t *number = number_of(packets, &frame, rates[i].field);

        if (number && json)
            printf(",\"%s\":%llu", rates[i].field, (unsigned long long)*number);
        else if (number && rates[i].tenths)
            printf(", %s %.1f%s", rates[i].before, (double)*number / 10, rates[i].after);
        else if (number)
            printf(", %s %llu%s", rates[i].before, (unsigned long long)*number, rates[i].after);
    }
    ddx_store_release(packets);
}

static void print_book(const struct book *book, bool json) {
    char instance[DDX_NAME_MAX + 1], line[DDX_STATS_LINE_MAX];
    DDX_STORE_ITEM *packets = book->stats.running ? book->packets : NULL;

    snprintf(instance, sizeof instance, "%.*s", (int)(strlen(book->name) - strlen(SUFFIX)), book->name);
    if (json) {
        int length = ddx_stats_json(&book->stats, instance, line, sizeof line);

        printf("%.*s", length - 1, line); /* its last brace comes after the rates */
        print_rates(packets, true);
        puts("}");
    } else {
        print_line(&book->stats, instance);
        print_rates(packets, false);
        putchar('\n');
    }
}

static int command_stats(DDX_STORE_ID *id, const struct request *request) {
    struct ddx_item_info *items;
    unsigned count;
    int status = 0, result = ddx_store_list(id, NULL, &items, &count);

    if (!result) {
        result = follow(id, items, count);
        free(items);
    }
    if (result)
        return complain(NULL, result);
    for (unsigned i = 0; i < book_count; i++)
        find_packets(id, &books[i]);
    if (book_count)
        qsort(books, book_count, sizeof *books, by_name);
    /* The first read takes a while, since the store must admit the handle. The second round reads all books at nearly
     * the same time, so that counters of programs that pass frames to each other fit together. */
    for (int round = 0; round < 2; round++)
        for (unsigned i = 0; i < book_count; i++)
            books[i].result = ddx_store_read(books[i].item, &books[i].stats, NULL, 0, DDX_CURRENT);
    for (unsigned i = 0; i < book_count; i++) {
        if (!books[i].result)
            print_book(&books[i], request->json);
        else if (books[i].result != -ETIMEDOUT) /* else its program has only just begun */
            status = complain(books[i].name, books[i].result);
    }
    fflush(stdout);
    return status;
}

/* ---- The command line ---- */

/* ---- Words of other packages ---- */

/* Words of other packages: `ddxctl WORD ...` is their program libexec/ddx/ctl-WORD, as `git WORD` is git-WORD. */

#define PREFIX "ctl-"

/* The folder of the words, relative to this program (/usr/libexec/ddx for /usr/bin/ddxctl), also in a desk build. */
static bool find_folder(char folder[PATH_MAX]) {
    static const char below[] = "/libexec/ddx";
    ssize_t length = readlink("/proc/self/exe", folder, PATH_MAX - sizeof below);

    if (length <= 0)
        return false;
    folder[length] = 0;
    for (int up = 0; up < 2; up++) { /* the program's name, then bin */
        char *slash = strrchr(folder, '/');

        if (!slash)
            return false;
        *slash = 0;
    }
    strcat(folder, below);
    return true;
}

/* No dots or slashes: the word must not lead to another folder. */
static bool is_word(const char *text) {
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-";

    return *text && *text != '-' && strlen(text) <= DDX_NAME_MAX && !text[strspn(text, letters)];
}

/*
 * Execute another package's program for the first of these words (the array ends with NULL). Returns only on failure:
 * the exit status, or -1 if there is no such program.
 */
static int run_word(char **words) {
    char folder[PATH_MAX], path[PATH_MAX + sizeof PREFIX + DDX_NAME_MAX + 1];

    if (!is_word(words[0]) || !find_folder(folder))
        return -1;
    snprintf(path, sizeof path, "%s/" PREFIX "%s", folder, words[0]);
    if (access(path, F_OK) < 0)
        return -1;
    const char *word = words[0];
    words[0] = path;
    execv(path, words);
    fprintf(stderr, "ddxctl: %s: %s: %s\n", word, path, strerror(errno));
    return 1;
}

static int is_theirs(const struct dirent *entry) {
    return !strncmp(entry->d_name, PREFIX, strlen(PREFIX)) && is_word(entry->d_name + strlen(PREFIX));
}

/* Each program prints its own lines, with its option -help. */
/* Print the help of all installed words to standard output. */
static void print_words(void) {
    static char option[] = "-help";
    char folder[PATH_MAX];
    struct dirent **found;
    int count = find_folder(folder) ? scandir(folder, &found, is_theirs, alphasort) : -1;

    if (count > 0)
        puts("\nInstalled beside it:");
    for (int i = 0; i < count; i++) {
        char *words[] = {found[i]->d_name + strlen(PREFIX), option, NULL};

        if (fflush(stdout)) /* the output's reader has exited */
            break;
        pid_t child = fork();
        if (!child)
            _exit(run_word(words));
        while (child > 0 && waitpid(child, NULL, 0) < 0 && errno == EINTR)
            continue;
    }
    for (int i = 0; i < count; i++)
        free(found[i]);
    if (count >= 0)
        free(found);
}

/* ---- Program ---- */

#define STORE_WAIT 1.0 /* s */

static const char usage_commands[] =
    "usage: ddxctl COMMAND [options]\n"
    "\n"
    "  list          all items: type, memory, readers, writer, age\n"
    "  show ITEM     the item's newest value, field by field\n"
    "  set ITEM FIELD=VALUE ...\n"
    "                write the newest value again, with these fields changed: imu.accel[0]=1.5,\n"
    "                name=text, gears=1,2,3; value=7 for an item that is not a struct. If the item's\n"
    "                program takes requests, change its settings: set video brightness=128\n"
    "  watch ITEM    a line for each write: number, time, missed writes\n"
    "  stats         counters of all programs: frames in, out, lost, latency\n"
    "\n"
    "  record start|stop|split|pre-roll SECONDS [INSTANCE]\n"
    "                start or stop recording, begin a new file with the next frame, or keep the last\n"
    "                seconds in memory while recording is stopped (default recorder: ddxvideosave)\n";

static const char usage_options[] = "\n"
                                    "  -json         for programs: one JSON object a line\n"
                                    "  -every S      list, show, stats: repeat every S seconds\n"
                                    "  -count N      exit after N writes (watch) or repetitions\n"
                                    "  -port N       the store's port; default 2005\n"
                                    "  -help         this text; -version\n"
                                    "\n"
                                    "Exit status: 0, 1 failed (no store, no such item), 2 bad usage.\n";

/* The words of other packages are between the two. */
static void print_usage(void) {
    fputs(usage_commands, stdout);
    print_words();
    fputs(usage_options, stdout);
}

static const struct {
    const char *name;
    bool needs_item, takes_changes;
    int (*run)(DDX_STORE_ID *id, const struct request *request);
} commands[] = {
    {"list", false, false, command_list},   {"show", true, false, command_show},
    {"set", true, true, command_set},       {"watch", true, false, command_watch},
    {"stats", false, false, command_stats}, {"record", true, true, command_record},
};
#define COMMANDS (sizeof commands / sizeof commands[0])

/* Index in commands[], or COMMANDS. */
static size_t find_command(const char *word) {
    size_t command = 0;

    while (command < COMMANDS && strcmp(word, commands[command].name) != 0)
        command++;
    return command;
}

static int bad_usage(const char *word, const char *problem) {
    fprintf(stderr, "ddxctl: %s: %s; see ddxctl -help\n", word, problem);
    return 2;
}

static bool seconds(const char *text, double least, double most, double *value) {
    char *end;

    *value = strtod(text, &end);
    return end != text && !*end && *value >= least && *value <= most;
}

/* Only decimal digits; 010 is ten. */
static bool number(const char *text, unsigned most, unsigned *value) {
    char *end;

    errno = 0;
    unsigned long long found = strtoull(text, &end, 10);
    *value = (unsigned)found;
    return !errno && *text >= '0' && *text <= '9' && !*end && found >= 1 && found <= most;
}

/* Whether the text is a valid name of an item. */
static bool is_name(const char *text) {
    size_t length = strlen(text);

    for (size_t i = 0; i < length; i++)
        if (text[i] <= ' ' || text[i] > '~' || text[i] == '/')
            return false;
    return length >= 1 && length <= DDX_NAME_MAX;
}

/* Flush standard output; an error fails the command. */
static int finish(int status) {
    if (!fflush(stdout) && !ferror(stdout))
        return status;
    fprintf(stderr, "ddxctl: standard output: %s\n", errno ? strerror(errno) : "cannot be written");
    return status ? status : 1;
}

static int repeat(size_t command, DDX_STORE_ID *id, const struct request *request) {
    struct timespec pause = {(time_t)request->every, (long)((request->every - (double)(time_t)request->every) * 1e9)};
    int status = commands[command].run(id, request);

    if (request->every <= 0 || commands[command].run == command_watch || commands[command].run == command_set)
        return status;
    for (unsigned i = 1; (request->count == 0 || i < request->count) && !ferror(stdout); i++) {
        nanosleep(&pause, NULL);
        status = commands[command].run(id, request);
        fflush(stdout);
    }
    return status;
}

int main(int argc, char **argv) {
    descriptors_open();
    static const struct option options[] = {{"json", no_argument, NULL, 'j'},
                                            {"every", required_argument, NULL, 'e'},
                                            {"count", required_argument, NULL, 'c'},
                                            {"port", required_argument, NULL, 'p'},
                                            {"help", no_argument, NULL, 'h'},
                                            {"version", no_argument, NULL, 'v'},
                                            {NULL, 0, NULL, 0}};
    struct request request = {.port = DDX_STORE_PORT};
    unsigned value;
    int option;

    if (argc > 1 && find_command(argv[1]) == COMMANDS) {
        int status = run_word(argv + 1);
        if (status >= 0)
            return status;
    }
    opterr = 0;
    while ((option = getopt_long_only(argc, argv, ":", options, NULL)) != -1) {
        switch (option) {
        case 'j': request.json = true; break;
        case 'e':
            if (!seconds(optarg, 0.01, 86400, &request.every))
                return bad_usage(optarg, "-every takes seconds from 0.01 to 86400");
            break;
        case 'c':
            if (!number(optarg, 1000000000, &request.count))
                return bad_usage(optarg, "-count takes a whole number from 1 to 1000000000");
            break;
        case 'p':
            if (!number(optarg, 65535, &value))
                return bad_usage(optarg, "-port takes a whole number from 1 to 65535");
            request.port = (int)value;
            break;
        case 'h': print_usage(); return finish(0);
        case 'v': version_print("ddxctl"); return finish(0);
        case ':': return bad_usage(argv[optind - 1], "needs a value");
        default: return bad_usage(argv[optind - 1], "unknown option");
        }
    }
    if (optind >= argc) {
        dup2(STDERR_FILENO, STDOUT_FILENO);
        print_usage();
        return 2;
    }
    size_t command = find_command(argv[optind]);
    if (command == COMMANDS)
        return bad_usage(argv[optind], "unknown command");
    int words = argc - optind - 1;
    if (words < commands[command].needs_item)
        return bad_usage(commands[command].name, commands[command].run == command_record
                                                     ? "needs a word: start, stop, split or pre-roll"
                                                     : "needs the name of an item");
    if (commands[command].run == command_set && words < 2)
        return bad_usage(commands[command].name, "needs field=value");
    if (words > commands[command].needs_item && !commands[command].takes_changes)
        return bad_usage(argv[argc - 1], "unexpected");
    if (commands[command].takes_changes) {
        request.changes = argv + optind + 2;
        request.change_count = (unsigned)(words - 1);
    }
    request.item = commands[command].needs_item ? argv[optind + 1] : NULL;
    if (request.item && commands[command].run != command_record && !is_name(request.item))
        return bad_usage(request.item, "no name of an item: those have 1 to 63 bytes, without blanks and slashes");

    DDX_STORE_ID *id = ddx_store_open(NULL, request.port, STORE_WAIT);
    if (!id)
        return complain(NULL, errno);
    int status = repeat(command, id, &request);
    ddx_store_close(id);
    return finish(status);
}
