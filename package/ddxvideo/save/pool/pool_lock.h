/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Locks of the pool and of its files, and the newest number. */
#ifndef DDXVIDEO_POOL_LOCK_H
#define DDXVIDEO_POOL_LOCK_H

#include "pool_state.h"

/* Open the file of locks, or create it. -errno on failure, such as -EACCES if the pool belongs to another user. */
int pool_lock_create(int folder);

/* Exclude other searches for a file, in this program or another one. Waits. */
void pool_lock(struct pool *pool);
void pool_unlock(struct pool *pool);

/* The highest number that a recorder of this pool has taken; 0: not known. The caller holds pool_lock(). */
uint32_t pool_newest(const struct pool *pool);
void pool_set_newest(const struct pool *pool, uint32_t number);

/* Lock a file of the pool until the result is closed. -EAGAIN: another recorder has it; or another -errno. */
int pool_lock_file(const struct pool *pool, long id);

/*
 * For programs that read recordings; `folder` is the pool's: prevent that a file is given up or used again until the
 * result is closed. -EAGAIN: a recorder has it. -EACCES: only the owner of the pool and root may hold files.
 */
int pool_hold_file(int folder, long id);

/* Whether this user may hold files. */
bool pool_can_hold(int folder);

/* Whether a recorder has the file. Takes no lock, and works for any user. */
bool pool_is_locked(int folder, long id);

/* Wait until the preparing thread has finished unfinished recordings. */
void pool_wait_for_recovery(struct pool *pool);

#endif
