/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Locks of the pool and of its files, and the newest number. */
#ifndef DDXVIDEO_POOL_LOCK_H
#define DDXVIDEO_POOL_LOCK_H

#include "pool_state.h"

/* Open the file of locks, created if there is none: -errno, such as -EACCES where the pool is another user's. */
int pool_lock_create(int folder);

/* Exclude other searches for a file, in this program or another one. Waits. */
void pool_lock(struct pool *pool);
void pool_unlock(struct pool *pool);

/* The highest number that a recorder of this pool has taken; 0 if that is not known. Between pool_lock() and unlock. */
uint32_t pool_newest(const struct pool *pool);
void pool_set_newest(const struct pool *pool, uint32_t number);

/* Lock a file of the pool until the result is closed; -EAGAIN: another one has it. Other -errno. */
int pool_lock_file(const struct pool *pool, long id);

/*
 * For programs that read recordings, with the pool's folder: keep a file from being given up or used again until the
 * result is closed. -EAGAIN: a recorder has it. -EACCES: only the owner of the pool and root can.
 */
int pool_hold_file(int folder, long id);

/* Whether this user may hold files. */
bool pool_can_hold(int folder);

/* Whether a recorder has the file. Locks nothing, and any user may ask. */
bool pool_is_locked(int folder, long id);

/* Until the thread that prepares has done what it does first. */
void pool_wait_for_recovery(struct pool *pool);

#endif
