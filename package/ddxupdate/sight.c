/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "sight.h"

#include <stdio.h>
#include <string.h>

#include "state.h"

#define CHECKING "is being checked"

/* The last line of the log of recordings-disk is its state. */
static bool is_checking(const struct place *place) {
    char path[PATH_MAX], line[512] = "";

    place_path(place, "/run/log/recordings-disk", path);
    FILE *file = fopen(path, "re");
    while (file && fgets(line, sizeof line, file))
        continue;
    if (file)
        fclose(file);
    return strstr(line, CHECKING) != NULL;
}

void sight_look(const struct place *place, struct sight *sight) {
    char path[PATH_MAX], text[WORD_MAX];

    frames_look(&sight->frames);
    services_look(place, &sight->services);
    network_look(place, &sight->network);
    place_path(place, "/sys/class/watchdog/watchdog0/state", path);
    sight->watchdog = place_line(path, text, sizeof text) && !strcmp(text, "active");
    sight->checking = is_checking(place);
}

static void add(char words[WORDS_MAX], const char *name) {
    const size_t length = strlen(words);

    if (length + strlen(name) + 2 <= WORDS_MAX)
        snprintf(words + length, WORDS_MAX - length, "%s%s", length ? " " : "", name);
}

static bool flows(const struct frames *before, const struct counter *now) {
    const struct counter *was = frames_find(before, now->name);

    return was && now->passed > was->passed;
}

void former_make(struct former *former, const struct sight *before, const struct sight *now) {
    *former = (struct former){.known = true, .ssh = now->ssh, .watchdog = now->watchdog};
    for (unsigned i = 0; i < now->services.count; i++)
        if (now->services.list[i].runs)
            add(former->runs, now->services.list[i].name);
    for (unsigned i = 0; i < now->frames.count; i++)
        if (now->frames.list[i].kind != LOGGER && flows(&before->frames, &now->frames.list[i]))
            add(former->flows, now->frames.list[i].name);
    for (unsigned i = 0; i < now->network.count; i++) {
        add(former->links, now->network.list[i].name);
        if (now->network.list[i].address)
            add(former->addresses, now->network.list[i].name);
    }
}

void former_read(struct former *former, const struct place *place, const char *version) {
    char value[WORDS_MAX];
    const char here[] = {place->here, 0};

    *former = (struct former){0};
    if (!state_is(place->state, "tried", here))
        return;
    state_get(place->state, "version", value, sizeof value);
    if (strcmp(value, version) != 0)
        return;
    former->known = true;
    state_get(place->state, "runs", former->runs, WORDS_MAX);
    state_get(place->state, "flows", former->flows, WORDS_MAX);
    state_get(place->state, "links", former->links, WORDS_MAX);
    state_get(place->state, "addresses", former->addresses, WORDS_MAX);
    former->ssh = state_is(place->state, "ssh", "yes");
    former->watchdog = state_is(place->state, "watchdog", "yes");
}

bool former_has(const char *words, const char *name) {
    const size_t length = strlen(name);

    for (const char *at = words; (at = strstr(at, name)); at += length)
        if ((at == words || at[-1] == ' ') && (!at[length] || at[length] == ' '))
            return true;
    return false;
}
