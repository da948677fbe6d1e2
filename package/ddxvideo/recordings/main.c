/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxrecordings: what is in a folder of recordings, whether it is whole, and copies of it. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "bytes.h"
#include "choose.h"
#include "descriptors.h"
#include "export.h"
#include "program.h"
#include "show.h"
#include "verify.h"
#include "version.h"

#define IDLE (3 << 13) /* the lowest class of ionice(1) */

static const char usage[] =
    "usage: ddxrecordings list [-json] [-folder DIR]\n"
    "       ddxrecordings verify [NAME...] [-folder DIR]\n"
    "       ddxrecordings export NAME...|all|newest FOLDER [-folder DIR]\n"
    "\n"
    "  list     recordings, oldest first; a recording is one or more files that follow each other without a gap\n"
    "  verify   reads files from the disk, compares each frame with its sum in the index (exit 1: it differs)\n"
    "  export   copies finished files into a folder, reads them back from there and compares\n"
    "\n"
    "  NAME     a recording as list shows it (video-000012), its number, or one of its files\n"
    "  -folder  where the recordings are; default /rec\n"
    "  -json    for programs: one JSON object a line\n"
    "\n"
    "Exit status: 0, 1 failed or not what was recorded, 2 bad usage.\n";

/* Lowest priority: programs that record, send or receive come first. */
static void step_back(void) {
    setpriority(PRIO_PROCESS, 0, 19);
    syscall(SYS_ioprio_set, 1, 0, IDLE);
}

static int verify(const struct folder *folder, const bool *chosen) {
    bool good = true;

    for (unsigned i = 0; i < folder->count; i++)
        if (chosen[i])
            good &= verify_file(folder, &folder->file[i]);
    return good ? EXIT_OK : EXIT_FAILED;
}

/* Only finished files are copied. */
static int export(const struct folder *folder, bool *chosen, const char *to) {
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

static int run(const struct folder *folder, const char *path, const char *command, char **words, bool json) {
    const char *to = NULL;

    if (!strcmp(command, "list")) {
        show_recordings(folder, json);
        if (!json)
            show_room(folder, path);
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
    if (status == EXIT_OK)
        status = to ? export(folder, chosen, to) : verify(folder, chosen);
    free(chosen);
    return status;
}

int main(int argc, char **argv) {
    descriptors_open();
    const char *path = "/rec", *command = NULL;
    char **words = argv; /* the arguments except options and command; never more than argv has */
    unsigned count = 0;
    bool json = false;
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
            json = true;
        else if (!strcmp(option, "folder") && i + 1 < argc)
            path = argv[++i];
        else
            program_bad_usage("%s: unknown option, or without its value", argv[i]);
    }
    words[count] = NULL;
    if (!command) {
        fputs(usage, stderr);
        return EXIT_USAGE;
    }
    bool list = !strcmp(command, "list"), exports = !strcmp(command, "export");
    if (!list && !exports && strcmp(command, "verify"))
        program_bad_usage("%s: unknown command", command);
    if (list ? count > 0 : exports && count < 2)
        program_bad_usage("%s: %s", command, list ? "takes no names" : "needs names (or all, or newest) and a folder");
    step_back();
    bytes_catch_signals();
    struct folder folder;
    int error = folder_open(&folder, path);
    if (error)
        say("%s: %s", path, strerror(-error));
    int status = error ? EXIT_FAILED : run(&folder, path, command, words, json);
    folder_close(&folder);
    return status;
}
