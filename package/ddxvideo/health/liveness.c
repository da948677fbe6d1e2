/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "liveness.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define SUFFIX ".stats"
#define LOOK_MAX INT64_C(2000000000) /* ns that count at most between two checks */

struct watched *liveness_find(const struct liveness *liveness, const char *name) {
    for (unsigned i = 0; i < liveness->count; i++)
        if (!strcmp(liveness->service[i].name, name))
            return (struct watched *)(uintptr_t)&liveness->service[i];
    return NULL;
}

static bool path_of(char *path, size_t size, const char *folder, const char *name, const char *file) {
    return snprintf(path, size, "%s/%s/%s", folder, name, file) < (int)size;
}

/* The process that runsv runs; 0 if there is none, or no runsv for the folder yet. */
static int32_t read_pid(const char *folder, const char *name) {
    char path[256];
    int pid = 0;
    FILE *file = path_of(path, sizeof path, folder, name, "supervise/pid") ? fopen(path, "re") : NULL;

    if (!file)
        return 0;
    if (fscanf(file, "%d", &pid) != 1)
        pid = 0;
    fclose(file);
    return pid;
}

static void look_at(struct liveness *liveness, const char *folder, const char *name) {
    char path[256];
    struct watched *service = liveness_find(liveness, name);

    if (!service) {
        if (liveness->count == WATCH_MAX || strlen(name) > DDX_NAME_MAX - strlen(SUFFIX))
            return;
        service = &liveness->service[liveness->count++];
        *service = (struct watched){.pid = 0};
        strcpy(service->name, name);
    }
    service->seen = true;
    service->down = path_of(path, sizeof path, folder, name, "down") && !access(path, F_OK);
    int32_t pid = read_pid(folder, name);
    if (pid != service->pid) {
        service->pid = pid;
        service->began = false;
        service->silent = 0;
        service->kills = 0;
        if (!strcmp(name, WATCH_STORE))
            liveness->refused = 0;
    }
}

static void look_at_folder(struct liveness *liveness, const char *folder) {
    for (unsigned i = 0; i < liveness->count; i++)
        liveness->service[i].seen = false;
    DIR *list = opendir(folder);
    if (!list)
        return;
    for (const struct dirent *entry; (entry = readdir(list)) != NULL;)
        if (*entry->d_name != '.')
            look_at(liveness, folder, entry->d_name);
    closedir(list);
    for (unsigned i = liveness->count; i-- > 0;)
        if (!liveness->service[i].seen)
            liveness->service[i] = liveness->service[--liveness->count];
}

static void note_sign(struct liveness *liveness, const struct ddx_item_info *item) {
    char name[DDX_NAME_MAX + 1];
    size_t length = strlen(item->name), suffix = strlen(SUFFIX);

    if (length <= suffix || strcmp(item->name + length - suffix, SUFFIX) != 0)
        return;
    memcpy(name, item->name, length - suffix);
    name[length - suffix] = 0;
    struct watched *service = liveness_find(liveness, name);
    /* A value of its previous process is no sign of life. */
    if (!service || !service->pid || item->writer_pid != service->pid || item->sequence == service->signs)
        return;
    service->signs = item->sequence;
    service->began = true;
    service->silent = 0;
}

void liveness_look(struct liveness *liveness, const char *folder, DDX_STORE_ID *id) {
    static int64_t last;
    struct ddx_item_info *items;
    unsigned count;

    look_at_folder(liveness, folder);
    int64_t begin = ddx_time_now(), passed = last ? begin - last : 0;
    last = begin;
    liveness->answered = !ddx_store_list(id, NULL, &items, &count);
    if (!liveness->answered) {
        /* No other program can be checked now. A missing store refuses at once, a hanging store blocks. */
        liveness->refused += ddx_time_now() - begin;
        return;
    }
    liveness->refused = 0;
    for (unsigned i = 0; i < liveness->count; i++)
        liveness->service[i].silent += passed < LOOK_MAX ? passed : LOOK_MAX;
    for (unsigned i = 0; i < count; i++)
        note_sign(liveness, &items[i]);
    free(items);
}

bool liveness_is_silent(const struct liveness *liveness, const struct watched *service, int64_t limit) {
    if (!service->pid || service->down)
        return false;
    if (!strcmp(service->name, WATCH_STORE))
        return liveness->refused >= limit;
    return service->began && service->silent >= limit;
}

int liveness_kill(struct watched *service, const char *folder) {
    char path[256];

    if (!path_of(path, sizeof path, folder, service->name, "supervise/control"))
        return -ENAMETOOLONG;
    int file = open(path, O_WRONLY | O_NONBLOCK | O_CLOEXEC);
    if (file < 0)
        return -errno;
    int result = write(file, "k", 1) == 1 ? 0 : -errno;
    close(file);
    service->kills++;
    return result;
}
