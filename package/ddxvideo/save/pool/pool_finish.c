/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "pool_finish.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "pool_files.h"
#include "pool_lock.h"
#include "pool_names.h"
#include "program.h"

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
