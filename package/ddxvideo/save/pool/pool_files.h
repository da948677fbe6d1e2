/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The pool from inside: what its parts know of each other. */
#ifndef DDXVIDEO_POOL_FILES_H
#define DDXVIDEO_POOL_FILES_H

#include <dirent.h>
#include <pthread.h>
#include <stdatomic.h>

#include "pool.h"

#define POOL_PATH 32 /* room for the name of a file in the pool */
#define POOL_ID_MAX 999999999L /* highest number of a file: fits a long, and a name */
#define POOL_READY 2 /* files that are kept ready */
#define POOL_LEFT_FREE (16u << 20) /* bytes of the disk, for logs, and what the file system needs for itself */

struct pool {
    const char *place, *instance; /* as pool_open() was given them */
    int outside; /* the folder of the recordings */
    int folder;  /* the pool in it */
    int lock_fd; /* its byte 0 is locked by pool_lock() */
    uint64_t bytes;
    bool recycle;
    uint32_t last_number; /* that we gave, and that may not be on the disk yet */
    pthread_mutex_t lock; /* of our threads; lock_fd has that of the programs */
    struct pool_file next;
    bool has_next; /* `next` is ready, and locked by us */
    /* of the thread that prepares: */
    pthread_t thread;
    pthread_cond_t changed;
    bool preparing;
    bool recovering; /* until then free files and numbers are unknown */
    atomic_bool stop;
    _Atomic uint64_t rate; /* bytes a second that are recorded */
    bool (*busy)(void *argument);
    void *argument;
};

/* Open the file of locks, created if there is none: -errno, such as -EACCES where the pool is another user's. */
int pool_lock_create(int folder);

/* Exclude other searches for a file, in this program or another one. Waits. */
void pool_lock(struct pool *pool);
void pool_unlock(struct pool *pool);

/* The highest number that a recorder of this pool has taken; 0 if that is not known. Between pool_lock() and unlock. */
uint32_t pool_newest(const struct pool *pool);
void pool_set_newest(const struct pool *pool, uint32_t number);

/* As pool_next_number(), between pool_lock() and pool_unlock(). */
uint32_t pool_take_number(struct pool *pool);

/* Another number for a recording whose name another file has: in header->name, too. */
void pool_renumber(struct index_header *header, uint32_t number);

/* As pool_finish(); `locked`: between pool_lock() and pool_unlock(). */
int pool_finish_locked(struct pool *pool, struct pool_file *file, struct index_header *header, bool locked);

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

/* Names in the pool's folder. */
void pool_data_name(char name[POOL_PATH], long id);
void pool_index_name(char name[POOL_PATH], long id);

/*
 * The number of a file, or of its index, from its name there; pool_data_id() takes no index. 0: the name is none that
 * the pool makes, so the file is not one of the pool's.
 */
long pool_id(const char *name);
long pool_data_id(const char *name);

/* The number in a recording's name, <item>-<number>-<UTC>.y4m; returns where the item's name ends. NULL: it has no
 * number. */
const char *pool_name_number(const char *name, uint32_t *number);

/* What is in a folder; NULL and errno. */
DIR *pool_list(int folder);

/* Call `visit` for the number of each file. It returns false to end the walk. 0 or -errno. */
int pool_each(struct pool *pool, bool (*visit)(struct pool *pool, long id, void *argument), void *argument);

/* Whether the file is a recording that has its name. It must not be recorded into. */
bool pool_is_named(const struct pool *pool, long id);

/* The header of an index; false if it has none, or a spoilt one. */
bool pool_read_header(int fd, struct index_header *header);

/* Lock the file and open both; false if another program has it, or on an error. `header` is the index's; a
 * damaged one is INDEX_RAW, and so is that of a deleted recording. */
bool pool_claim(struct pool *pool, long id, struct pool_file *file, struct index_header *header);

/* Claim an unused file in this state. False if there is none. */
bool pool_find(struct pool *pool, uint32_t state, struct pool_file *file);

/* Mark the recording in it, of that number of bytes, as free. */
void pool_forget(struct pool_file *file, struct index_header *header, uint64_t bytes);

/* A new file, ours; neither file nor index has any contents. */
int pool_create(struct pool *pool, struct pool_file *file);

/* All of the index: an empty one. */
int pool_write_index(const struct pool_file *file, uint32_t state);

/* Blocks for all of it, in one piece where the disk has one. A file system that cannot gives them as it is written. */
int pool_allocate(const struct pool *pool, const struct pool_file *file);

/* Whether the disk has space for one more file, and a reserve for other programs. */
bool pool_has_room(const struct pool *pool);

/* Give up the oldest recording: its file becomes ours, without its name, INDEX_RAW. -ENOENT: there is none. */
int pool_recycle(struct pool *pool, struct pool_file *file);

/* Until the thread that prepares has done what it does first. */
void pool_wait_for_recovery(struct pool *pool);

#endif
