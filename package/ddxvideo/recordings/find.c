/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "find.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "find_file.h"
#include "pool_files.h"

#define LOOKS_MAX 10

/* ---- Files of the pool ---- */

struct pooled {
    ino_t inode;
    struct found found;
};

struct pooled_list {
    struct pooled *file;
    unsigned count;
};

static bool add_pooled(struct pooled_list *list, const struct pooled *file) {
    struct pooled *more = realloc(list->file, (list->count + 1) * sizeof *more);

    if (!more)
        return false;
    list->file = more;
    more[list->count++] = *file;
    return true;
}

static int look_once(const struct folder *folder, struct pooled_list *list) {
    DIR *pool = folder->pool < 0 ? NULL : pool_list(folder->pool);
    int error = 0;

    if (!pool)
        return folder->pool < 0 ? 0 : -errno;
    for (struct dirent *entry = readdir(pool); entry && !error; entry = readdir(pool)) {
        struct stat status;
        long id = pool_data_id(entry->d_name);

        if (!id || fstatat(folder->pool, entry->d_name, &status, 0))
            continue;
        struct pooled file = {.inode = status.st_ino, .found = {.id = id}};
        bool named = status.st_nlink > 1, indexed = find_indexed(folder->pool, named, &file.found);
        if (!indexed)
            file.found = (struct found){.spoilt = true};
        if ((indexed || named) && !add_pooled(list, &file))
            error = -ENOMEM;
    }
    closedir(pool);
    return error;
}

static bool same(const struct pooled_list *one, const struct pooled_list *other) {
    bool same = one->count == other->count;

    for (unsigned i = 0; same && i < one->count; i++) {
        const struct found *a = &one->file[i].found, *b = &other->file[i].found;

        same = a->id == b->id && a->number == b->number && a->state == b->state;
    }
    return same;
}

/*
 * A recorder may end a file and begin the next one during the scan, which then sees the next one before it is locked,
 * and the former one unlocked: a running recording would be reported as interrupted. So scans repeat until two agree.
 */
static int look_at_pool(const struct folder *folder, struct pooled_list *list) {
    int error = look_once(folder, list);

    for (unsigned looks = 1; !error && looks < LOOKS_MAX; looks++) {
        struct pooled_list before = *list;

        *list = (struct pooled_list){NULL, 0};
        error = look_once(folder, list);
        bool agreed = same(&before, list);
        free(before.file);
        if (agreed)
            break;
    }
    return error;
}

/* ---- Files of the folder ---- */

void found_clean(char *text) {
    for (; *text; text++)
        if (*text < ' ' || *text > '~')
            *text = '?';
}

static int add(struct folder *folder, const struct found *found) {
    struct found *more = realloc(folder->file, (folder->count + 1) * sizeof *more);

    if (!more)
        return -ENOMEM;
    folder->file = more;
    more[folder->count] = *found;
    strcpy(more[folder->count].shown, found->name);
    found_clean(more[folder->count++].shown);
    return 0;
}

static struct pooled *with_inode(const struct pooled_list *list, ino_t inode) {
    for (unsigned i = 0; i < list->count; i++)
        if (list->file[i].inode == inode)
            return &list->file[i];
    return NULL;
}

static int add_named(struct folder *folder, const char *name, const struct pooled_list *list) {
    struct stat status;
    struct found found = {.id = 0};

    if (fstatat(folder->fd, name, &status, AT_SYMLINK_NOFOLLOW) || !S_ISREG(status.st_mode))
        return 0;
    struct pooled *pooled = with_inode(list, status.st_ino);
    if (pooled) {
        found = pooled->found;
        pooled->found.id = 0; /* taken */
    }
    snprintf(found.name, sizeof found.name, "%s", name);
    if (found.id)
        found.bytes = (uint64_t)status.st_size;
    else if (!find_plain(folder->fd, &found) && !found.spoilt)
        return 0;
    return add(folder, &found);
}

static int look_at_names(struct folder *folder, const struct pooled_list *list) {
    DIR *names = pool_list(folder->fd);
    int error = 0;

    if (!names)
        return -errno;
    for (struct dirent *entry = readdir(names); entry && !error; entry = readdir(names)) {
        const char *end = strrchr(entry->d_name, '.');

        if (end && end != entry->d_name && !strcmp(end, ".y4m"))
            error = add_named(folder, entry->d_name, list);
    }
    closedir(names);
    for (unsigned i = 0; i < list->count && !error; i++)
        if (list->file[i].found.id && list->file[i].found.state >= FOUND_INTERRUPTED)
            error = add(folder, &list->file[i].found); /* has no name yet */
    return error;
}

static int in_order(const void *a, const void *b) {
    const struct found *one = a, *other = b;

    if (one->session != other->session)
        return one->session < other->session ? -1 : 1;
    if (one->number != other->number)
        return one->number < other->number ? -1 : 1;
    return strcmp(one->name, other->name);
}

int folder_open(struct folder *folder, const char *path) {
    struct pooled_list list = {NULL, 0};

    *folder = (struct folder){.fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC), .pool = -1};
    if (folder->fd < 0)
        return -errno;
    folder->pool = openat(folder->fd, POOL_FOLDER, O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
    int error = folder->pool < 0 && errno != ENOENT ? -errno : look_at_pool(folder, &list);
    if (!error)
        error = look_at_names(folder, &list);
    free(list.file);
    if (folder->count)
        qsort(folder->file, folder->count, sizeof *folder->file, in_order);
    return error;
}

void folder_close(struct folder *folder) {
    free(folder->file);
    if (folder->pool >= 0)
        close(folder->pool);
    if (folder->fd >= 0)
        close(folder->fd);
}

/* ---- One file ---- */

const char *found_state_name(enum found_state state) {
    static const char *const names[] = {"finished", "recovered", "cut off", "interrupted", "recording"};

    return names[state];
}

int found_open(const struct folder *folder, const struct found *found, bool *direct) {
    char name[POOL_PATH];

    pool_data_name(name, found->id);
    int from = found->id ? folder->pool : folder->fd;
    const char *path = found->id ? name : found->name;
    int fd = find_open(from, path, O_DIRECT);
    *direct = fd >= 0;
    return fd == -EINVAL ? find_open(from, path, 0) : fd;
}

int found_open_index(const struct folder *folder, const struct found *found) {
    char name[POOL_PATH];

    pool_index_name(name, found->id);
    return find_open(folder->pool, name, 0);
}

int found_hold(const struct folder *folder, const struct found *found, int *hold) {
    /* A file of a running recording is locked by its recorder. */
    int fd = found->state < FOUND_INTERRUPTED ? pool_hold_file(folder->pool, found->id) : -1;

    *hold = fd < 0 ? -1 : fd;
    return fd == -EAGAIN ? -EBUSY : 0;
}

bool found_is_given_up(int index_fd, const struct found *found) {
    struct index_header header;

    return !pool_read_header(index_fd, &header) || header.recording != found->recording;
}
