/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxrecordings: what is in a folder of recordings, whether it is whole, copies of it, and its removal. */
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "actions.h"
#include "bytes.h"
#include "ddx_time.h"
#include "find.h"
#include "pool_files.h"
#include "program.h"
#include "verify.h"

/* ---- Show ---- */

/* The number of files of a recording; they follow each other in folder->file from `first` on. */
static unsigned show_count(const struct folder *folder, unsigned first) {
    unsigned end = first + 1;

    while (end < folder->count && folder->file[first].session && folder->file[first].id && folder->file[end].id &&
           folder->file[end].session == folder->file[first].session)
        end++;
    return end - first;
}

/* "video-000012"; for a file without a number, its name. */
static void show_name(const struct found *found, char name[NAME_MAX + 1]) {
    if (found->session)
        snprintf(name, NAME_MAX + 1, "%s-%06u", found->item, (unsigned)found->session);
    else
        snprintf(name, NAME_MAX + 1, "%s", found->name);
}

static void utc(int64_t wall, char text[32]) {
    time_t seconds = (time_t)(wall / SECOND);
    struct tm fields;

    if (!wall || !strftime(text, 32, "%Y-%m-%dT%H:%M:%SZ", gmtime_r(&seconds, &fields)))
        strcpy(text, "-");
}

/* The sums over all files of a recording. */
static struct found sum_up(const struct found *file, unsigned count) {
    struct found sum = file[0];

    for (unsigned i = 1; i < count; i++) {
        sum.frames += file[i].frames;
        sum.bytes += file[i].bytes;
        sum.duration += file[i].duration;
        sum.lost_store += file[i].lost_store;
        sum.lost_ring += file[i].lost_ring;
        sum.lost_encode += file[i].lost_encode;
        if (file[i].state > sum.state)
            sum.state = file[i].state;
    }
    return sum;
}

static void quoted(const char *text) {
    putchar('"');
    for (; *text; text++) {
        unsigned char c = (unsigned char)*text;

        if (c == '"' || c == '\\')
            printf("\\%c", c);
        else if (c < 0x20 || c == 0x7f)
            printf("\\u%04x", c);
        else
            putchar(c);
    }
    putchar('"');
}

static void show_json(const struct found *file, unsigned count, const struct found *sum, const char *name,
                      const char *begin) {
    printf("{\"recording\":");
    quoted(name);
    printf(",\"item\":");
    quoted(sum->item);
    printf(",\"utc\":");
    if (*begin == '-')
        printf("null");
    else
        quoted(begin);
    printf(",\"frames\":%" PRIu64 ",\"seconds\":%" PRId64 ".%03d,\"bytes\":%" PRIu64 ",\"state\":\"%s\"", sum->frames,
           sum->duration / SECOND, (int)(sum->duration % SECOND / 1000000), sum->bytes, found_state_name(sum->state));
    if (sum->id)
        printf(",\"lost\":{\"store\":%" PRIu64 ",\"ring\":%" PRIu64 ",\"encode\":%" PRIu64 "}", sum->lost_store,
               sum->lost_ring, sum->lost_encode);
    else
        printf(",\"lost\":null");
    printf(",\"files\":[");
    for (unsigned i = 0; i < count; i++) {
        if (i)
            putchar(',');
        quoted(file[i].name);
    }
    puts("]}");
}

static void show_line(unsigned count, const struct found *sum, const char *name, const char *begin) {
    char lost[64] = "?";

    if (sum->id)
        snprintf(lost, sizeof lost, "%" PRIu64, sum->lost_store + sum->lost_ring + sum->lost_encode);
    printf("%-20s %-20s %5u %8" PRIu64 " %9" PRId64 ".%d %8" PRIu64 " %6s  %s\n", name, begin, count, sum->frames,
           sum->duration / SECOND, (int)(sum->duration % SECOND / (SECOND / 10)), (sum->bytes + (1 << 20) - 1) >> 20,
           lost, found_state_name(sum->state));
}

/* Print a line on the room left on the disk. The remaining time is at the rate of the running recordings so far. */
static void show_room(const struct folder *folder, const char *path) {
    struct free_space room;
    uint64_t rate = 0;

    for (unsigned i = 0; i < folder->count; i++)
        if (folder->file[i].state == FOUND_RECORDING && folder->file[i].duration)
            rate += (uint64_t)((double)folder->file[i].bytes * 1e9 / (double)folder->file[i].duration);
    if (free_space_look(path, &room))
        return;
    printf("room for %" PRIu64 " MB of recordings", room.usable >> 20);
    if (rate)
        printf(", %" PRIu64 " min at this rate", room.usable / rate / 60);
    printf("; %" PRIu64 " MB of it in prepared files, %" PRIu64 " MB free", room.prepared >> 20, room.free >> 20);
    if (folder->pool >= 0)
        printf("; files ready: %" PRIu32, room.ready);
    putchar('\n');
}

/* Print a line for each recording, oldest first. */
static void show_recordings(const struct folder *folder, bool json) {
    char name[NAME_MAX + 1], begin[32];

    if (!json)
        printf("%-20s %-20s %5s %8s %11s %8s %6s  %s\n", "RECORDING", "BEGIN (UTC)", "FILES", "FRAMES", "SECONDS", "MB",
               "LOST", "STATE");
    for (unsigned i = 0, count; i < folder->count; i += count) {
        const struct found *file = &folder->file[i];

        count = show_count(folder, i);
        const struct found sum = sum_up(file, count);
        show_name(file, name);
        utc(file->wall, begin);
        if (json) {
            show_json(file, count, &sum, name, begin);
        } else {
            found_clean(name);
            show_line(count, &sum, name, begin);
        }
    }
}

/* ---- Choice of recordings ---- */

static bool is_meant(const struct found *first, const char *word) {
    char name[NAME_MAX + 1], *end;

    show_name(first, name);
    unsigned long number = strtoul(word, &end, 10);
    return !strcmp(word, name) || (end != word && !*end && number && number == first->session);
}

/*
 * Set chosen[], which has an entry for each file, for a word: "all", "newest" (the newest recording), a recording
 * (video-000012, or its number alone), or a file's name. False: the word stands for no file. Prints nothing.
 */
static bool choose_files(const struct folder *folder, const char *word, bool *chosen) {
    bool any = false, all = !strcmp(word, "all"), newest = !strcmp(word, "newest");

    for (unsigned i = 0, count; i < folder->count; i += count) {
        count = show_count(folder, i);
        bool whole = all || (newest && i + count == folder->count) || is_meant(&folder->file[i], word);
        for (unsigned k = i; k < i + count; k++)
            if (whole || !strcmp(folder->file[k].name, word))
                any = chosen[k] = true;
    }
    return any;
}

/* ---- Program ---- */

#define IDLE (3 << 13) /* the lowest class of ionice(1) */

static const char usage[] =
    "usage: ddxrecordings list [-json] [-folder DIR]\n"
    "       ddxrecordings verify [NAME...] [-progress] [-folder DIR]\n"
    "       ddxrecordings export NAME...|all|newest FOLDER [-progress] [-folder DIR]\n"
    "       ddxrecordings remove NAME... [-folder DIR]\n"
    "       ddxrecordings read FILE [FROM] [-size] [-folder DIR]\n"
    "\n"
    "  list     recordings, oldest first; a recording is one or more files that follow each other without a gap\n"
    "  verify   reads files from the disk, compares each frame with its sum in the index (exit 1: it differs)\n"
    "  export   copies finished files into a folder, reads them back from there and compares\n"
    "  remove   removes them; none, if one is being recorded, copied or read\n"
    "  read     writes a finished file to standard output, from byte FROM on (default 0)\n"
    "\n"
    "  NAME     a recording as list shows it (video-000012), its number, or one of its files\n"
    "  -folder  where the recordings are; default /rec\n"
    "  -json    for programs: one JSON object a line\n"
    "  -progress\n"
    "           a line for each percent of all bytes that are to be read: \"12 %\"\n"
    "  -size    before the bytes of read, a line with the size of the file\n"
    "\n"
    "Exit status: 0, 1 failed or not what was recorded, 2 bad usage.\n";

/* Lowest priority: programs that record, send or receive come first. */
static void step_back(void) {
    setpriority(PRIO_PROCESS, 0, 19);
    syscall(SYS_ioprio_set, 1, 0, IDLE);
}

/* Each byte is read `times`. */
static void show_progress(const struct folder *folder, const bool *chosen, unsigned times) {
    uint64_t bytes = 0;

    for (unsigned i = 0; i < folder->count; i++)
        if (chosen[i])
            bytes += folder->file[i].bytes;
    bytes_show_progress(bytes * times);
}

static int verify(const struct folder *folder, const bool *chosen, bool progress) {
    bool good = true;

    if (progress)
        show_progress(folder, chosen, 1);
    for (unsigned i = 0; i < folder->count; i++)
        if (chosen[i])
            good &= verify_file(folder, &folder->file[i]);
    return good ? EXIT_OK : EXIT_FAILED;
}

/* Only finished files are copied. */
static int export(const struct folder *folder, bool *chosen, const char *to, bool progress) {
    bool any = false;

    for (unsigned i = 0; i < folder->count; i++) {
        if (chosen[i] && folder->file[i].state >= FOUND_INTERRUPTED) {
            say("%s: is not finished, left out", folder->file[i].shown);
            chosen[i] = false;
        }
        any |= chosen[i];
    }
    if (!any) {
        say("no finished recording to export");
        return EXIT_FAILED;
    }
    if (progress)
        show_progress(folder, chosen, 2); /* the copies are read back */
    return export_files(folder, chosen, to);
}

/* Sets chosen[] for the words between command and target. */
static int choose(const struct folder *folder, char **words, bool *chosen) {
    static char all[] = "all";
    static char *everything[] = {all, NULL};
    int status = EXIT_OK;
    bool optional = !*words;

    for (char **word = optional ? everything : words; *word; word++)
        if (!choose_files(folder, *word, chosen) && !optional) {
            say("%s: there is no such recording; `list` shows all", *word);
            status = EXIT_USAGE;
        }
    return status;
}

/* `words` are a file's name, and the first byte of it that is wanted. */
static int read_one(const struct folder *folder, char **words, bool size) {
    uint64_t from = 0;

    if (words[1]) {
        char *end;

        errno = 0;
        from = strtoull(words[1], &end, 10);
        if (errno || *end || *words[1] < '0' || *words[1] > '9')
            program_bad_usage("%s: a number of bytes is needed", words[1]);
    }
    for (unsigned i = 0; i < folder->count; i++)
        if (!strcmp(folder->file[i].name, words[0]))
            return read_file(folder, &folder->file[i], from, size);
    say("%s: there is no such file; `list -json` shows all", words[0]);
    return EXIT_USAGE;
}

struct wishes {
    const char *folder;
    bool json, progress, size;
};

static int run(const struct folder *folder, const char *command, char **words, const struct wishes *wishes) {
    const char *to = NULL;

    if (!strcmp(command, "read"))
        return read_one(folder, words, wishes->size);
    if (!strcmp(command, "list")) {
        show_recordings(folder, wishes->json);
        if (!wishes->json)
            show_room(folder, wishes->folder);
        return EXIT_OK;
    }
    if (!strcmp(command, "export")) {
        unsigned last = 0;

        while (words[last + 1])
            last++;
        to = words[last];
        words[last] = NULL;
    }
    bool *chosen = calloc(folder->count + 1, sizeof *chosen);
    if (!chosen) {
        say("%s", strerror(ENOMEM));
        return EXIT_FAILED;
    }
    int status = choose(folder, words, chosen);
    if (status == EXIT_OK && !strcmp(command, "remove"))
        status = remove_files(folder, chosen);
    else if (status == EXIT_OK)
        status = to ? export(folder, chosen, to, wishes->progress) : verify(folder, chosen, wishes->progress);
    free(chosen);
    return status;
}

static const struct {
    const char *name;
    unsigned least, most; /* words after it */
    const char *needs;
} commands[] = {
    {"list", 0, 0, "takes no names"},
    {"verify", 0, UINT_MAX, ""},
    {"export", 2, UINT_MAX, "needs names (or all, or newest) and a folder"},
    {"remove", 1, UINT_MAX, "needs names"},
    {"read", 1, 2, "needs the name of a file, and may have the first byte that is wanted"},
};

/* Exits on bad usage. */
static void check_words(const char *command, unsigned count) {
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++) {
        if (strcmp(command, commands[i].name) != 0)
            continue;
        if (count < commands[i].least || count > commands[i].most)
            program_bad_usage("%s: %s", command, commands[i].needs);
        return;
    }
    program_bad_usage("%s: unknown command", command);
}

int main(int argc, char **argv) {
    descriptors_open();
    const char *command = NULL;
    char **words = argv; /* the arguments except options and command; never more than argv has */
    unsigned count = 0;
    struct wishes wishes = {.folder = "/rec"};
    say_as("ddxrecordings");
    for (int i = 1; i < argc; i++) {
        const char *option = argv[i][0] != '-' ? "" : argv[i] + (argv[i][1] == '-' ? 2 : 1);

        if (!*option && !command)
            command = argv[i];
        else if (!*option)
            words[count++] = argv[i];
        else if (!strcmp(option, "help"))
            return fputs(usage, stdout) < 0;
        else if (!strcmp(option, "version"))
            return version_print("ddxrecordings"), ferror(stdout) != 0;
        else if (!strcmp(option, "json"))
            wishes.json = true;
        else if (!strcmp(option, "progress"))
            wishes.progress = true;
        else if (!strcmp(option, "size"))
            wishes.size = true;
        else if (!strcmp(option, "folder") && i + 1 < argc)
            wishes.folder = argv[++i];
        else
            program_bad_usage("%s: unknown option, or without its value", argv[i]);
    }
    words[count] = NULL;
    if (!command) {
        fputs(usage, stderr);
        return EXIT_USAGE;
    }
    check_words(command, count);
    step_back();
    bytes_catch_signals();
    struct folder folder;
    int error = folder_open(&folder, wishes.folder);
    if (error)
        say("%s: %s", wishes.folder, strerror(-error));
    int status = error ? EXIT_FAILED : run(&folder, command, words, &wishes);
    folder_close(&folder);
    return status;
}
