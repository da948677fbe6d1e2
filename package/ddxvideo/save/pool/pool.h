/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Files to record into, which were written in full before: recording overwrites them in place. So no metadata of the
 * file system changes while frames are written, and a power cut leaves none half changed.
 *
 * `<folder>/pool/<NNNNNN>.y4m` with its index `<NNNNNN>.index`. Names never change. A finished recording is the same
 * file with a second name, `<folder>/<item>-<NNNNNN>-<UTC>.y4m` or .mp4. Several recorders of one user share a pool:
 * each file has a lock, and the pool has one for searches. Locks are bytes of `pool/lock`, which only the owner of the
 * pool and root can open, so that no other user can keep a recorder waiting (pool_files.c).
 */
#ifndef DDXVIDEO_POOL_H
#define DDXVIDEO_POOL_H

#include "pool_files.h"
#include "pool_names.h"
#include "pool_recover.h"

/*
 * Start a thread that recovers, and then keeps files ready; it prepares files while `busy`, which it calls, returns
 * false. pool_take() waits for the recovery. 0 or -errno.
 */
int pool_prepare(struct pool *pool, bool (*busy)(void *argument), void *argument);

/* The recording's rate in bytes a second: files are prepared at twice this rate, so as not to disturb it. 0: none. */
void pool_recorded_at(struct pool *pool, uint64_t rate);

/*
 * Open the pool below `folder`, or create it, for this instance of the recorder. Both texts stay the caller's, and must
 * stay valid as long as the pool. Files get `bytes` bytes, or less on a small disk. With `recycle` the oldest recording
 * is given up when the disk is full. 0 or -errno.
 */
int pool_open(const char *folder, const char *instance, uint64_t bytes, bool recycle, struct pool **pool);

/* Stop the thread, and free the pool. */
void pool_close(struct pool *pool);

/* Size of a file. */
uint64_t pool_file_bytes(const struct pool *pool);

/*
 * Take a file to record into: a prepared one, or one that is made now, which takes as long as the disk needs for some
 * metadata. -ENOSPC: the disk is full, and no recording may be given up.
 */
int pool_take(struct pool *pool, struct pool_file *file);

#endif
