/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Words of other packages: `ddxctl WORD ...` is their program libexec/ddx/ctl-WORD, as `git WORD` is git-WORD. */
#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "ddxctl.h"

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

int run_word(char **words) {
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
void print_words(void) {
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
