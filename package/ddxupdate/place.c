/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "place.h"

#include <stdio.h>
#include <string.h>

#include "line.h"

static void path_of(char path[PATH_MAX], const char *root, const char *name) {
    snprintf(path, PATH_MAX, "%s%s", root, name);
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

    *place = (struct place){0};
    path_of(place->block_lock, root, "/run/update.block");
    path_of(place->lock, root, "/run/update.lock");
    path_of(place->mount, root, "/run/update.slot");
    path_of(place->release, root, "/etc/os-release");
    path_of(place->keys, root, "/etc/ddx/update-keys");
    path_of(place->wrong, root, "/run/slot.wrong");
    path_of(place->failed, root, "/run/slot.failed");
    path_of(place->state, root, "/data/update");
    path_of(words, root, "/proc/cmdline");
    read_words(place, words);
}

void place_note(const char *path, const char *text) {
    FILE *file = fopen(path, "we");

    if (!file)
        return;
    fprintf(file, "%s\n", text);
    fclose(file);
}
