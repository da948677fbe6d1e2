/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "pool.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

#include "ddx_time.h"
#include "program.h"

/* ---- The thread that keeps files ready ---- */

/*
 * The thread that keeps files ready. It writes only while the recorder does not need the disk, at most half of the
 * time, and twice as fast as recordings are written, which is sufficient to stay ahead.
 */

#define CHUNK (1u << 20)
#define PAUSE (SECOND / 20)
#define SLOWEST (UINT64_C(8) << 20) /* bytes a second, if little or nothing is recorded */
#define LOOK 5                      /* s; another program may have taken the ready files */

static bool count_free(struct pool *pool, long id, void *argument) {
    struct pool_file file;
    struct index_header header;

    if (!pool_is_named(pool, id) && pool_claim(pool, id, &file, &header)) {
        *(unsigned *)argument += header.state == INDEX_FREE;
        pool_release(&file);
    }
    return true;
}

/* How many files are ready and free. */
static unsigned pool_ready(struct pool *pool) {
    unsigned count = 0;

    pool_lock(pool);
    pool_each(pool, count_free, &count);
    count += pool->has_next;
    pool_unlock(pool);
    return count;
}

static void pause_for(int64_t time) {
    struct timespec duration = {.tv_sec = (time_t)(time / SECOND), .tv_nsec = (long)(time % SECOND)};

    clock_nanosleep(CLOCK_MONOTONIC, 0, &duration, NULL);
}

/* How long to leave the disk alone after a chunk that took `took` ns. */
static int64_t pause_after(const struct pool *pool, int64_t took) {
    uint64_t rate = 2 * pool->rate > SLOWEST ? 2 * pool->rate : SLOWEST;
    int64_t rest = (int64_t)(CHUNK * (uint64_t)SECOND / rate) - took;

    return rest > took ? rest : took;
}

/* Writes each byte that has not been written yet. 0; -ECANCELED on a request to stop; or -errno. */
static int fill(struct pool *pool, struct pool_file *file) {
    int error = pool_allocate(pool, file);

    if (error)
        return error;
    /* Never written, so that each of its pages is the kernel's page of zeros, and takes no memory. */
    void *zeros = mmap(NULL, CHUNK, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (zeros == MAP_FAILED)
        return -errno;
    for (uint64_t at = file->written; at < pool->bytes && !error;) {
        while (!pool->stop && pool->busy(pool->argument))
            pause_for(PAUSE);
        int64_t begin = ddx_time_now();
        ssize_t done = pool->stop ? -1 : pwrite(file->fd, zeros, CHUNK, (off_t)at);
        if (pool->stop)
            error = -ECANCELED;
        else if (done <= 0)
            error = done ? -errno : -EIO;
        else
            at += (uint64_t)done;
        pause_for(pause_after(pool, ddx_time_now() - begin));
    }
    munmap(zeros, CHUNK);
    return error;
}

/* A new file may have no name on the disk after a failed flush, and a later flush would not report that. */
static void remove_file(struct pool *pool, const struct pool_file *file) {
    char name[POOL_PATH];

    pool_lock(pool); /* otherwise another program could be taking it */
    pool_data_name(name, file->id);
    unlinkat(pool->folder, name, 0);
    pool_index_name(name, file->id);
    unlinkat(pool->folder, name, 0);
    pool_unlock(pool);
}

/* Prepares a claimed file. */
static int prepare(struct pool *pool, struct pool_file *file) {
    struct index_header header = {.state = INDEX_FREE};
    int error = pool_write_index(file, INDEX_RAW);

    if (!error)
        error = fill(pool, file);
    if (!error && (ftruncate(file->fd, (off_t)pool->bytes) || fsync(file->fd) || fsync(file->index_fd)))
        error = -errno;
    if (!error)
        error = pool_write_header(file, &header);
    if (!error && (fsync(file->index_fd) || fsync(pool->folder))) {
        error = -errno;
        remove_file(pool, file);
    }
    file->prepared = !error;
    return error;
}

/* Claims a file to prepare. False if there is none, and none can be made. */
static bool find_work(struct pool *pool, struct pool_file *file) {
    if (pool_find(pool, INDEX_RAW, file))
        return true;
    if (pool_has_room(pool))
        return !pool_create(pool, file);
    return pool->recycle && !pool_recycle(pool, file);
}

/* Keeps the next file claimed, and prepares another one if too few are ready. True if one was prepared. */
static bool work(struct pool *pool) {
    struct pool_file file;

    pool_lock(pool);
    if (!pool->has_next && pool_find(pool, INDEX_FREE, &pool->next))
        pool->has_next = true;
    pool_unlock(pool);
    if (pool_ready(pool) >= POOL_READY)
        return false;
    pool_lock(pool);
    bool found = find_work(pool, &file);
    pool_unlock(pool);
    if (!found)
        return false;
    int error = prepare(pool, &file);
    if (error && error != -ECANCELED)
        say("pool: %06ld.y4m cannot be prepared: %s", file.id, strerror(-error));
    pool_release(&file);
    return !error;
}

/* Recording begins even if former recordings cannot be finished; they stay unchanged. */
static void recover(struct pool *pool) {
    int error = pool_recover(pool);

    if (error)
        say("pool: an unfinished recording cannot be finished: %s", strerror(-error));
    pthread_mutex_lock(&pool->lock);
    pool->recovering = false;
    pthread_cond_broadcast(&pool->changed);
    pthread_mutex_unlock(&pool->lock);
}

static void *prepare_files(void *argument) {
    struct pool *pool = argument;

    program_thread_signals();
    program_thread_ordinary();
    recover(pool);
    while (!pool->stop) {
        if (work(pool))
            continue;
        struct timespec until;
        clock_gettime(CLOCK_MONOTONIC, &until);
        until.tv_sec += LOOK;
        pthread_mutex_lock(&pool->lock);
        if (!pool->stop)
            pthread_cond_timedwait(&pool->changed, &pool->lock, &until);
        pthread_mutex_unlock(&pool->lock);
    }
    return NULL;
}

void pool_recorded_at(struct pool *pool, uint64_t rate) {
    pool->rate = rate;
}

int pool_prepare(struct pool *pool, bool (*busy)(void *argument), void *argument) {
    pool->busy = busy;
    pool->argument = argument;
    pool->recovering = true;
    int error = -pthread_create(&pool->thread, NULL, prepare_files, pool);
    pool->preparing = !error;
    if (error)
        pool->recovering = false;
    return error;
}

/* ---- Files for the recorder ---- */

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
