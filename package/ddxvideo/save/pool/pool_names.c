/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "pool_names.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "program.h"

const char *pool_name_number(const char *name, uint32_t *number) {
    size_t length = strlen(name);
    const char *end_of = length > 4 ? name + length - 4 : "";
    const char *stamp = !strcmp(end_of, ".y4m") || !strcmp(end_of, ".mp4") ? strrchr(name, '-') : NULL;
    const char *dash = stamp ? memrchr(name, '-', (size_t)(stamp - name)) : NULL;
    char *end;

    if (!dash || dash[1] < '0' || dash[1] > '9')
        return NULL;
    unsigned long long value = strtoull(dash + 1, &end, 10);
    if (end != stamp || !value || value > UINT32_MAX)
        return NULL;
    *number = (uint32_t)value;
    return dash;
}

static bool highest_in_use(struct pool *pool, long id, void *argument) {
    uint32_t *most = argument;
    char name[POOL_PATH];
    struct index_header header;

    if (pool_is_named(pool, id))
        return true;
    pool_index_name(name, id);
    int fd = openat(pool->folder, name, O_RDONLY | O_CLOEXEC);
    if (fd >= 0 && pool_read_header(fd, &header) && header.number > *most)
        *most = header.number;
    if (fd >= 0)
        close(fd);
    return true;
}

static void highest_in_names(struct pool *pool, uint32_t *most) {
    DIR *folder = pool_list(pool->outside);
    uint32_t number;

    for (struct dirent *entry = folder ? readdir(folder) : NULL; entry; entry = readdir(folder))
        if (pool_name_number(entry->d_name, &number) && number <= INT32_MAX && number > *most)
            *most = number; /* a larger one is not ours; this leaves numbers above it */
    if (folder)
        closedir(folder);
}

/* As pool_next_number(), between pool_lock() and pool_unlock(). */
static uint32_t pool_take_number(struct pool *pool) {
    uint32_t most = pool_newest(pool);

    if (pool->last_number > most)
        most = pool->last_number;
    /* Names last: a recording that gets its name in between is found in one of the two. */
    pool_each(pool, highest_in_use, &most);
    highest_in_names(pool, &most);
    pool->last_number = most + 1;
    pool_set_newest(pool, most + 1);
    return most + 1;
}

uint32_t pool_next_number(struct pool *pool) {
    pool_wait_for_recovery(pool);
    pool_lock(pool);
    uint32_t number = pool_take_number(pool);
    pool_unlock(pool);
    return number;
}

/* From item and number in the header, and the time of the start. */
static void set_name(struct index_header *header, const char *stamp) {
    snprintf(header->name, sizeof header->name, "%s-%06u-%s", header->item, (unsigned)header->number, stamp);
    for (char *c = header->name; *c; c++)
        if (*c == '/')
            *c = '_'; /* an item's name may hold one */
}

void pool_name(const struct pool *pool, struct index_header *header, const char *item, uint32_t number) {
    char stamp[32];
    time_t now = time(NULL);
    struct tm utc;

    snprintf(header->item, sizeof header->item, "%s", item);
    snprintf(header->instance, sizeof header->instance, "%s", pool->instance);
    strftime(stamp, sizeof stamp, header->format == INDEX_MP4 ? "%Y%m%dT%H%M%SZ.mp4" : "%Y%m%dT%H%M%SZ.y4m",
             gmtime_r(&now, &utc));
    header->number = number;
    set_name(header, stamp);
}

/* Change the number of a recording whose name another file has, also in header->name. */
static void pool_renumber(struct index_header *header, uint32_t number) {
    char stamp[32];
    const char *dash = strrchr(header->name, '-');

    snprintf(stamp, sizeof stamp, "%s", dash ? dash + 1 : ".y4m");
    if (header->session == header->number)
        header->session = number;
    header->number = number;
    set_name(header, stamp);
}

/* ---- The oldest ---- */

struct oldest {
    uint32_t number;
    ino_t inode;
    char name[NAME_MAX + 1];
};

/* Lock the file that has this inode. */
struct wanted {
    ino_t inode;
    struct pool_file *file;
    bool found;
};

static bool claim_inode(struct pool *pool, long id, void *argument) {
    struct wanted *wanted = argument;
    char name[POOL_PATH];
    struct stat status;
    struct index_header header;

    pool_data_name(name, id);
    if (fstatat(pool->folder, name, &status, 0) || status.st_ino != wanted->inode)
        return true;
    wanted->found = pool_claim(pool, id, wanted->file, &header);
    return false;
}

/* Whether one recording is older than the other. Recordings of different pools may have the same number. */
static bool is_before(uint32_t number, const char *name, const struct oldest *other) {
    return number != other->number ? number < other->number : strcmp(name, other->name) < 0;
}

/* The oldest recording that is newer than `after`. */
static bool next_oldest(struct pool *pool, const struct oldest *after, struct oldest *oldest) {
    DIR *folder = pool_list(pool->outside);
    uint32_t number;

    oldest->number = 0;
    for (struct dirent *entry = folder ? readdir(folder) : NULL; entry; entry = readdir(folder)) {
        if (!pool_name_number(entry->d_name, &number) || is_before(number, entry->d_name, after) ||
            !strcmp(entry->d_name, after->name) || (oldest->number && !is_before(number, entry->d_name, oldest)))
            continue;
        oldest->number = number;
        oldest->inode = entry->d_ino;
        strcpy(oldest->name, entry->d_name);
    }
    if (folder)
        closedir(folder);
    return oldest->number;
}

int pool_recycle(struct pool *pool, struct pool_file *file) {
    struct oldest oldest = {.number = 0}, before = oldest;
    struct stat status;
    struct index_header header;

    for (; next_oldest(pool, &before, &oldest); before = oldest) {
        struct wanted wanted = {.inode = oldest.inode, .file = file};

        pool_each(pool, claim_inode, &wanted);
        if (!wanted.found)
            continue; /* not in the pool, or held by a reader */
        int error = unlinkat(pool->outside, oldest.name, 0) || fsync(pool->outside) || fstat(file->fd, &status);
        if (!error) {
            pool_forget(file, &header, (uint64_t)status.st_size);
            error = pool_write_header(file, &header) || fsync(file->index_fd);
        }
        if (!error)
            return 0;
        error = errno ? -errno : -EIO;
        pool_release(file);
        return error;
    }
    return -ENOENT;
}

/* ---- The end of a recording ---- */

/* 0; -EEXIST: another file has this name; -errno. */
static int give_name(const struct pool *pool, const struct pool_file *file, const char *name) {
    char own[POOL_PATH];
    struct stat this, other;

    pool_data_name(own, file->id);
    if (!linkat(pool->folder, own, pool->outside, name, 0))
        return 0;
    if (errno != EEXIST || fstat(file->fd, &this) || fstatat(pool->outside, name, &other, AT_SYMLINK_NOFOLLOW))
        return -errno;
    return this.st_ino == other.st_ino && this.st_dev == other.st_dev ? 0 : -EEXIST;
}

/* Takes another number, first in the index, before the file has such a name. 0 or -errno. */
static int take_other_number(struct pool *pool, struct pool_file *file, struct index_header *header, bool locked) {
    char name[sizeof header->name];

    strcpy(name, header->name);
    if (!locked)
        pool_lock(pool);
    pool_renumber(header, pool_take_number(pool));
    if (!locked)
        pool_unlock(pool);
    say("%s/%s: another file has this name; the recording is %s", pool->place, name, header->name);
    int error = pool_write_header(file, header);
    return error ? error : fsync(file->index_fd) ? -errno : 0;
}

int pool_finish(struct pool *pool, struct pool_file *file, struct index_header *header) {
    return pool_finish_locked(pool, file, header, false);
}

int pool_finish_locked(struct pool *pool, struct pool_file *file, struct index_header *header, bool locked) {
    int error = 0;

    /* On the disk before another file gets the blocks that are free now: two files must not have them. */
    if (ftruncate(file->fd, (off_t)header->bytes) || fsync(file->fd))
        error = -errno;
    while (!error && (error = give_name(pool, file, header->name)) == -EEXIST)
        error = take_other_number(pool, file, header, locked);
    if (!error && fsync(pool->outside))
        error = -errno;
    header->state = INDEX_NAMED; /* only with the name on the disk: otherwise a power cut would delete the recording */
    if (!error)
        error = pool_write_header(file, header);
    if (!error && fsync(file->index_fd))
        error = -errno;
    pool_release(file);
    return error;
}
