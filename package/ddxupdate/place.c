/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "place.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

const char *line_value(const char *line, const char *name) {
    const size_t length = strlen(name);

    return !strncmp(line, name, length) && line[length] == '=' ? line + length + 1 : NULL;
}

void place_path(const struct place *place, const char *name, char path[PATH_MAX]) {
    snprintf(path, PATH_MAX, "%s%s", place->root, name);
}

/* Copy the value if the word is NAME=VALUE. */
static void take(const char *word, const char *name, char value[WORD_MAX]) {
    const char *found = line_value(word, name);

    if (found)
        snprintf(value, WORD_MAX, "%s", found);
}

static void read_words(struct place *place, const char *path) {
    FILE *file = fopen(path, "re");
    char line[4096] = "", slot[WORD_MAX] = "", *rest = NULL;

    if (file) {
        line[fread(line, 1, sizeof line - 1, file)] = 0;
        fclose(file);
    }
    for (char *word = strtok_r(line, " \n", &rest); word; word = strtok_r(NULL, " \n", &rest)) {
        take(word, "ddx.slot", slot);
        take(word, "ddx.counted", place->counted);
        take(word, "ddx.layout", place->layout);
    }
    place->here = !strcmp(slot, "A") || !strcmp(slot, "B") ? slot[0] : 0;
}

void place_find(struct place *place, const char *root) {
    char words[PATH_MAX];

    *place = (struct place){.root = root};
    place_path(place, "/run/update.block", place->block_lock);
    place_path(place, "/run/update.lock", place->lock);
    place_path(place, "/run/update.slot", place->mount);
    place_path(place, "/etc/os-release", place->release);
    place_path(place, "/etc/ddx/update-keys", place->keys);
    place_path(place, "/run/slot.wrong", place->wrong);
    place_path(place, "/run/slot.failed", place->failed);
    place_path(place, "/data/update", place->state);
    place_path(place, "/run/update.trial", place->progress);
    place_path(place, "/etc/ddx/trial", place->rules);
    place_path(place, "/proc/cmdline", words);
    read_words(place, words);
}

bool place_line(const char *path, char *text, int size) {
    FILE *file = fopen(path, "re");
    const bool found = file && fgets(text, size, file);

    if (found)
        text[strcspn(text, "\n")] = 0;
    else
        *text = 0;
    if (file)
        fclose(file);
    return found;
}

void place_note(const char *path, const char *text) {
    FILE *file = fopen(path, "we");

    if (!file)
        return;
    fprintf(file, "%s\n", text);
    fclose(file);
}

int fail(int result, const char *format, ...) {
    char text[512];
    va_list words;

    va_start(words, format);
    vsnprintf(text, sizeof text, format, words);
    va_end(words);
    /* A version or a name may come from an update file. */
    for (char *at = text; *at; at++)
        if ((unsigned char)*at < ' ' || *at == 0x7f)
            *at = '?';
    fprintf(stderr, "ddxupdate: %s\n", text);
    return result;
}
