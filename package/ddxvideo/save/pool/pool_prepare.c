/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The thread that keeps files ready. It writes only while the recorder does not need the disk, at most half of the
 * time, and twice as fast as recordings are written, which is sufficient to stay ahead.
 */
#include "pool_prepare.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "pool_files.h"
#include "pool_lock.h"
#include "pool_names.h"
#include "pool_recover.h"
#include "program.h"

#define CHUNK (1u << 20)
#define NS INT64_C(1000000000)
#define PAUSE (NS / 20)
#define SLOWEST (UINT64_C(8) << 20) /* bytes a second, if little or nothing is recorded */
#define LOOK 5 /* s; another program may have taken the ready files */

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

static void pause_for(int64_t time) {
    struct timespec duration = {.tv_sec = (time_t)(time / NS), .tv_nsec = (long)(time % NS)};

    clock_nanosleep(CLOCK_MONOTONIC, 0, &duration, NULL);
}

/* How long to leave the disk alone after a chunk that took `took` ns. */
static int64_t pause_after(const struct pool *pool, int64_t took) {
    uint64_t rate = 2 * pool->rate > SLOWEST ? 2 * pool->rate : SLOWEST;
    int64_t rest = (int64_t)(CHUNK * (uint64_t)NS / rate) - took;

    return rest > took ? rest : took;
}

/* Writes each byte that has not been written yet. 0; -ECANCELED on a request to stop; or -errno. */
static int fill(struct pool *pool, const struct pool_file *file) {
    unsigned char *zeros;
    int error = pool_allocate(pool, file);

    if (error || posix_memalign((void **)&zeros, INDEX_BLOCK, CHUNK))
        return error ? error : -ENOMEM;
    memset(zeros, 0, CHUNK);
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
    free(zeros);
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
