/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "pool.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

#include "pool_files.h"
#include "program.h"

#define SMALLEST (4u << 20)
#define SHARE 8 /* files that even a small disk has room for */

/* ---- Open and close ---- */

/* The pool of one program; another size than the one asked for where the disk is small. */
static int set_up(struct pool *pool, const char *folder, uint64_t bytes) {
    struct statvfs disk;

    pool->outside = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (pool->outside < 0)
        return -errno;
    if (mkdirat(pool->outside, POOL_FOLDER, 0755) && errno != EEXIST)
        return -errno;
    pool->folder = openat(pool->outside, POOL_FOLDER, O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
    if (pool->folder < 0 || fstatvfs(pool->folder, &disk))
        return -errno;
    pool->lock_fd = pool_lock_create(pool->folder);
    if (pool->lock_fd < 0)
        return pool->lock_fd;
    uint64_t fits = (uint64_t)disk.f_blocks * disk.f_frsize / SHARE;
    pool->bytes = (bytes < fits ? bytes : fits) >> 20 << 20;
    if (pool->bytes < SMALLEST)
        pool->bytes = SMALLEST;
    return 0;
}

int pool_open(const char *folder, const char *instance, uint64_t bytes, bool recycle, struct pool **result) {
    struct pool *pool = calloc(1, sizeof *pool);

    if (!pool)
        return -ENOMEM;
    *pool = (struct pool){
        .place = folder, .instance = instance, .outside = -1, .folder = -1, .lock_fd = -1, .recycle = recycle};
    pthread_mutex_init(&pool->lock, NULL);
    program_condition(&pool->changed);
    int error = set_up(pool, folder, bytes);
    if (error)
        pool_close(pool);
    else
        *result = pool;
    return error;
}

void pool_close(struct pool *pool) {
    if (pool->preparing) {
        pthread_mutex_lock(&pool->lock);
        pool->stop = true;
        pthread_cond_signal(&pool->changed);
        pthread_mutex_unlock(&pool->lock);
        pthread_join(pool->thread, NULL);
    }
    if (pool->has_next)
        pool_release(&pool->next);
    if (pool->lock_fd >= 0)
        close(pool->lock_fd);
    if (pool->folder >= 0)
        close(pool->folder);
    if (pool->outside >= 0)
        close(pool->outside);
    pthread_cond_destroy(&pool->changed);
    pthread_mutex_destroy(&pool->lock);
    free(pool);
}

uint64_t pool_file_bytes(const struct pool *pool) {
    return pool->bytes;
}

/* ---- Take ---- */

static bool count_free(struct pool *pool, long id, void *argument) {
    struct pool_file file;
    struct index_header header;

    if (!pool_is_named(pool, id) && pool_claim(pool, id, &file, &header)) {
        *(unsigned *)argument += header.state == INDEX_FREE;
        pool_release(&file);
    }
    return true;
}

unsigned pool_ready(struct pool *pool) {
    unsigned count = 0;

    pool_lock(pool);
    pool_each(pool, count_free, &count);
    count += pool->has_next;
    pool_unlock(pool);
    return count;
}

/* Without a prepared file: one that is half prepared, a new one, or the oldest recording's, with room for all. */
static int make(struct pool *pool, struct pool_file *file) {
    int error = -ENOSPC;

    if (pool_find(pool, INDEX_RAW, file))
        error = 0;
    else if (pool_has_room(pool))
        error = pool_create(pool, file);
    else if (pool->recycle && (error = pool_recycle(pool, file)) == -ENOENT)
        error = -ENOSPC;
    if (error)
        return error;
    file->prepared = false;
    error = pool_allocate(pool, file);
    if (!error)
        error = pool_write_index(file, INDEX_RAW);
    if (error)
        pool_release(file);
    return error;
}

int pool_take(struct pool *pool, struct pool_file *file) {
    pool_wait_for_recovery(pool);
    pthread_mutex_lock(&pool->lock);
    bool found = pool->has_next;
    if (found)
        *file = pool->next;
    pool->has_next = false;
    pthread_cond_signal(&pool->changed);
    pthread_mutex_unlock(&pool->lock);
    if (found)
        return 0;
    pool_lock(pool);
    int error = pool_find(pool, INDEX_FREE, file) ? 0 : make(pool, file);
    pool_unlock(pool);
    return error;
}

void pool_give_back(struct pool_file *file) {
    struct index_header header = {.state = file->prepared ? INDEX_FREE : INDEX_RAW};

    pool_write_header(file, &header);
    pool_release(file);
}

/* ---- Finish ---- */

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

/* The index has it before the file has such a name. 0 or -errno. */
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

    /* On the disk before anybody else gets the blocks that are free now: two files must not claim them. */
    if (ftruncate(file->fd, (off_t)header->bytes) || fsync(file->fd))
        error = -errno;
    while (!error && (error = give_name(pool, file, header->name)) == -EEXIST)
        error = take_other_number(pool, file, header, locked);
    if (!error && fsync(pool->outside))
        error = -errno;
    header->state = INDEX_NAMED; /* after the name is on the disk: else a power cut would delete the recording */
    if (!error)
        error = pool_write_header(file, header);
    if (!error && fsync(file->index_fd))
        error = -errno;
    pool_release(file);
    return error;
}
