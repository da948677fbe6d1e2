/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Files to record into, written in full before: recording overwrites them in place, so that no metadata of the file
 * system changes in the path of the frames, and a power cut finds none half changed.
 *
 * `<folder>/pool/<NNNNNN>.y4m` with its index `<NNNNNN>.index`. Names never change. A finished recording is the same
 * file under a second name, `<folder>/<item>-<NNNNNN>-<UTC>.y4m`. Several recorders of one user share a pool: each file
 * has a lock, and the pool has one for a program that looks for a file. Locks are bytes of `pool/lock`, which only the
 * owner of the pool and root can open: no other user can keep a recorder waiting (pool_lock.c).
 */
#ifndef DDXVIDEO_POOL_H
#define DDXVIDEO_POOL_H

#include <stdbool.h>
#include <stdint.h>

#include "index.h"

#define POOL_FOLDER "pool"

struct pool;

/* A file of the pool that is ours. */
struct pool_file {
    long id;       /* its name */
    int fd;        /* of the file, O_DIRECT if the file system can */
    int index_fd;  /* of the index */
    int lock_fd;   /* locked as long as it is open */
    bool direct;
    bool prepared; /* no metadata is left to be written but what this program changes itself */
    uint64_t written; /* not prepared: up to there it has been written once all the same */
};

/*
 * Open the pool below `folder`, create it if there is none, for this instance of the recorder. Both texts stay the
 * caller's, and have to stay as long as the pool. Files get `bytes` bytes, or less on a small disk. With
 * `recycle` the oldest recording is given up when the disk is full. Returns 0 or -errno.
 */
int pool_open(const char *folder, const char *instance, uint64_t bytes, bool recycle, struct pool **pool);

/* Finish unfinished recordings; waits for the disk. 0, or -errno for one that fails. */
int pool_recover(struct pool *pool);

/*
 * How many frames with numbers above that are in the newest files of this instance which were finished by a later
 * recorder, as after pool_recover() all are whose own one was killed.
 */
uint64_t pool_recovered_frames(struct pool *pool, uint64_t above);

/*
 * Recover, and then keep files ready, in a thread of its own, which prepares files while `busy` (called from there)
 * returns false. Taking a file waits for the recovery. 0 or -errno.
 */
int pool_prepare(struct pool *pool, bool (*busy)(void *argument), void *argument);

/* The recording's rate in bytes a second: files are prepared at twice this rate, so as not to disturb it. 0: none. */
void pool_recorded_at(struct pool *pool, uint64_t rate);

/* Ends the thread, frees the pool. */
void pool_close(struct pool *pool);

/* Room of a file. */
uint64_t pool_file_bytes(const struct pool *pool);

/* How many files are ready, and free for anybody. Opens nothing. */
unsigned pool_ready(struct pool *pool);

/*
 * A file to record into: a prepared one; else one that is made now, which takes as long as the disk needs for some
 * metadata. -ENOSPC: the disk is full and nothing may be given up.
 */
int pool_take(struct pool *pool, struct pool_file *file);

/*
 * The number of the next recording, whatever item it is of: above all that there are, and taken from now on for every
 * recorder of this pool.
 */
uint32_t pool_next_number(struct pool *pool);

/* Write instance, item, number and name, which has the present time in it, into the header. */
void pool_name(const struct pool *pool, struct index_header *header, const char *item, uint32_t number);

/*
 * The recording in the file has header->bytes bytes, which are on the disk, as is its index: cut it, give it its name,
 * close it. Where another file has that name, the recording gets another number, after a line. 0 or -errno.
 */
int pool_finish(struct pool *pool, struct pool_file *file, struct index_header *header);

/* Header block of the index, in place, with its checksum. The caller syncs. */
int pool_write_header(const struct pool_file *file, struct index_header *header);

/* Close it unchanged; the next program that opens the pool finishes it. */
void pool_release(struct pool_file *file);

/* Nothing was recorded: the file is free. */
void pool_give_back(struct pool_file *file);

#endif
