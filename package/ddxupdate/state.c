/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "state.h"

#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "place.h"

static bool is_set(const char *line, const struct state_line *lines, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (line_value(line, lines[i].name))
            return true;
    return false;
}

void state_get(const char *path, const char *name, char *value, size_t size) {
    FILE *file = fopen(path, "re");
    char *line = NULL;
    size_t room = 0;

    *value = 0;
    while (file && getline(&line, &room, file) > 0) {
        const char *found = line_value(line, name);
        if (found)
            snprintf(value, size, "%.*s", (int)strcspn(found, "\n"), found);
    }
    free(line);
    if (file)
        fclose(file);
}

bool state_is(const char *path, const char *name, const char *value) {
    char found[64];

    state_get(path, name, found, sizeof found);
    return !strcmp(found, value);
}

static void copy_others(FILE *to, const char *path, const struct state_line *lines, size_t count) {
    FILE *from = fopen(path, "re");
    char *line = NULL;
    size_t room = 0;

    while (from && getline(&line, &room, from) > 0)
        if (!is_set(line, lines, count))
            fprintf(to, "%.*s\n", (int)strcspn(line, "\n"), line);
    free(line);
    if (from)
        fclose(from);
}

static int sync_folder(const char *path) {
    char name[PATH_MAX];

    snprintf(name, sizeof name, "%s", path);
    const int folder = open(dirname(name), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    const int error = folder < 0 || fsync(folder) ? -errno : 0;
    if (folder >= 0)
        close(folder);
    return error;
}

int state_set(const char *path, const struct state_line *lines, size_t count) {
    char new[PATH_MAX];
    int error = 0;

    snprintf(new, sizeof new, "%s.new", path);
    FILE *file = fopen(new, "we");
    if (!file)
        return fail(-errno, "%s: %s", new, strerror(errno));
    copy_others(file, path, lines, count);
    for (size_t i = 0; i < count; i++)
        fprintf(file, "%s=%s\n", lines[i].name, lines[i].value);
    if (fflush(file) || ferror(file) || fsync(fileno(file)))
        error = errno ? -errno : -EIO;
    fclose(file);
    if (!error && rename(new, path))
        error = -errno;
    if (!error)
        error = sync_folder(path);
    if (!error)
        return 0;
    unlink(new);
    return fail(error, "%s: cannot be written: %s; is /data full?", path, strerror(-error));
}

char state_proven(const char *path) {
    char value[2 + 1]; /* a longer one is cut, and is none */

    state_get(path, "proven", value, sizeof value);
    return !strcmp(value, "A") || !strcmp(value, "B") ? value[0] : 0;
}

void state_prove(const char *path, char slot) {
    const char value[] = {slot, 0};
    const struct state_line line = {"proven", value};

    if (state_proven(path) != slot)
        state_set(path, &line, 1);
}
