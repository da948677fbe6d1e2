/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "pool.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "pool_lock.h"
#include "program.h"

#define SMALLEST (4u << 20)
#define SHARE 8 /* files for which even a small disk has room */

/* ---- Open and close ---- */

/* Opens folders and lock, and chooses the size of files, which is less than `bytes` on a small disk. */
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

/* Without a prepared file: takes one that is half prepared, a new one, or that of the oldest recording. */
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
