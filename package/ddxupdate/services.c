/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "services.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "place.h"

#define FULL "make room and start again" /* a recorder's and a logger's last words on a full disk */
enum { TAIL = 1024 /* bytes of a log: a few starts, each of which fails */ };

static void take(const char *word, struct service *service) {
    const char *enabled = line_value(word, "enabled"), *state = line_value(word, "state");

    if (enabled)
        service->enabled = !strcmp(enabled, "yes");
    if (state) {
        service->runs = !strcmp(state, "running");
        service->misconfigured = !strcmp(state, "misconfigured");
    }
}

void services_read(const struct place *place, struct services *services) {
    char path[PATH_MAX], line[256], *rest = NULL;

    services->count = 0;
    place_path(place, "/run/update.services", path);
    FILE *file = fopen(path, "re");
    while (file && services->count < SERVICES_MAX && fgets(line, sizeof line, file)) {
        const char *name = strtok_r(line, " \n", &rest);
        if (!name || strlen(name) >= WORD_MAX || strchr(name, '/'))
            continue;
        struct service *service = &services->list[services->count++];
        *service = (struct service){0};
        strcpy(service->name, name);
        for (const char *word; (word = strtok_r(NULL, " \n", &rest));)
            take(word, service);
        /* A service with a wrong line counts as disabled there. */
        service->enabled |= service->misconfigured;
    }
    if (file)
        fclose(file);
}

static bool there(const char *folder, const char *name) {
    char path[PATH_MAX + WORD_MAX];

    snprintf(path, sizeof path, "%s/%s", folder, name);
    return !access(path, F_OK);
}

static void line_of(const char *folder, const char *name, char text[WORD_MAX]) {
    char path[PATH_MAX + WORD_MAX];

    snprintf(path, sizeof path, "%s/%s", folder, name);
    place_line(path, text, WORD_MAX);
}

/* The folder belongs to the log's user, so no link is followed. */
static bool log_ends_with(const struct place *place, const char *name, const char *words) {
    char path[PATH_MAX], log[2 * WORD_MAX], text[TAIL];

    snprintf(log, sizeof log, "/run/log/%s/current", name);
    place_path(place, log, path);
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (fd < 0)
        return false;
    const off_t size = lseek(fd, 0, SEEK_END);
    const ssize_t got = pread(fd, text, sizeof text, size > TAIL ? size - TAIL : 0);
    close(fd);
    return got > 0 && memmem(text, (size_t)got, words, strlen(words));
}

void services_look(const struct place *place, struct services *services) {
    char folder[PATH_MAX], name[2 * WORD_MAX], text[WORD_MAX];

    for (unsigned i = 0; i < services->count; i++) {
        struct service *service = &services->list[i];
        snprintf(name, sizeof name, "/run/service/%s", service->name);
        place_path(place, name, folder);
        service->runs = false;
        if (!there(folder, "run"))
            continue;
        service->stopped = there(folder, "down");
        service->misconfigured = there(folder, "misconfigured") && !service->stopped;
        line_of(folder, "supervise/stat", text);
        service->runs = (!strncmp(text, "run", 3) && !there(folder, "waiting")) || there(folder, "complete");
        service->full = log_ends_with(place, service->name, FULL);
        line_of(folder, "restarts", text);
        service->restarts = (unsigned)strtoul(text, NULL, 10);
    }
}
