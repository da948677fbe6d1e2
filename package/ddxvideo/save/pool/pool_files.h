/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The pool's files: names, headers, search, and the space for more. */
#ifndef DDXVIDEO_POOL_FILES_H
#define DDXVIDEO_POOL_FILES_H

#include <dirent.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "index.h"

#define POOL_FOLDER "pool"
#define POOL_PATH 32               /* bytes for the name of a file in the pool */
#define POOL_ID_MAX 999999999L     /* highest number of a file: fits a long, and a name */
#define POOL_READY 2               /* files that are kept ready */
#define POOL_LEFT_FREE (16u << 20) /* bytes of the disk, for logs and the file system itself */

/* A claimed file of the pool. */
struct pool_file {
    long id;      /* its name */
    int fd;       /* of the file, with O_DIRECT if supported */
    int index_fd; /* of the index */
    int lock_fd;  /* locked as long as it is open */
    bool direct;
    bool prepared;    /* no metadata is left to write, except changes by this program */
    bool allocated;   /* of a file that is not prepared: all of its blocks are allocated */
    uint64_t written; /* if not prepared: bytes that have been written once all the same */
};

struct pool {
    const char *place, *instance; /* arguments of pool_open() */
    int outside;                  /* the folder of the recordings */
    int folder;                   /* the pool in it */
    int lock_fd;                  /* its byte 0 is locked by pool_lock() */
    uint64_t bytes;
    bool recycle;
    uint32_t last_number; /* given last, perhaps not on the disk yet */
    pthread_mutex_t lock; /* between threads; lock_fd is between programs */
    struct pool_file next;
    bool has_next; /* `next` is ready and claimed */
    /* of the preparing thread: */
    pthread_t thread;
    pthread_cond_t changed;
    bool preparing;
    bool recovering; /* free files and numbers are not known yet */
    atomic_bool stop;
    _Atomic uint64_t rate; /* bytes a second of the recording */
    bool (*busy)(void *argument);
    void *argument;
};

/* Open the file of locks, or create it. -errno on failure, such as -EACCES if the pool belongs to another user. */
int pool_lock_create(int folder);

/* Exclude other searches for a file, in this program or another one. Waits. */
void pool_lock(struct pool *pool);
void pool_unlock(struct pool *pool);

/* The highest number that a recorder of this pool has taken; 0: not known. The caller holds pool_lock(). */
uint32_t pool_newest(const struct pool *pool);
void pool_set_newest(const struct pool *pool, uint32_t number);

/*
 * For programs that read recordings; `folder` is the pool's: prevent that a file is given up or used again until the
 * result is closed. -EAGAIN: a recorder has it. -EACCES: only the owner of the pool and root may hold files.
 */
int pool_hold_file(int folder, long id);

/* For a program that changes or removes a file: the same, and -EAGAIN also if another program holds it. */
int pool_hold_alone(int folder, long id);

/* Whether this user may hold files. */
bool pool_can_hold(int folder);

/* Whether a recorder has the file. Takes no lock, and works for any user. */
bool pool_is_locked(int folder, long id);

/* Wait until the preparing thread has finished unfinished recordings. */
void pool_wait_for_recovery(struct pool *pool);

/* Names of a file and its index in the pool's folder. */
void pool_data_name(char name[POOL_PATH], long id);
void pool_index_name(char name[POOL_PATH], long id);

/*
 * The number in the name of a file or an index; pool_data_id(): of a file only. 0: the pool does not make such names,
 * so it is not a file of the pool.
 */
long pool_data_id(const char *name);

/* List a folder. NULL and errno on failure. */
DIR *pool_list(int folder);

/* Call `visit` with the number of each file, until it returns false. 0 or -errno. */
int pool_each(struct pool *pool, bool (*visit)(struct pool *pool, long id, void *argument), void *argument);

/* Whether the file is a recording with a name. It must not be overwritten. */
bool pool_is_named(const struct pool *pool, long id);

/* Read the header of an index. False if it has none, or an invalid one. */
bool pool_read_header(int fd, struct index_header *header);

/* Lock the file, open it and its index, and read `header`; INDEX_RAW stands for a damaged one, and for that of a
 * deleted recording. False if another program has the file, or on an error. */
bool pool_claim(struct pool *pool, long id, struct pool_file *file, struct index_header *header);

/* Claim an unused file in this state. False if there is none. */
bool pool_find(struct pool *pool, uint32_t state, struct pool_file *file);

/* Mark the file as free, with that number of bytes already written. */
void pool_forget(struct pool_file *file, struct index_header *header, uint64_t bytes);

/* Create a file and lock it; file and index are empty. */
int pool_create(struct pool *pool, struct pool_file *file);

/* Write the whole index, without entries. */
int pool_write_index(const struct pool_file *file, uint32_t state);

/* Allocate blocks for the whole file, in one piece if possible. Some file systems allocate them only on writing. */
int pool_allocate(const struct pool *pool, struct pool_file *file);

/* Whether the disk has space for one more file and a reserve for other programs. */
bool pool_has_room(const struct pool *pool);

/* Write the header of the index, with its checksum. The caller syncs. */
int pool_write_header(const struct pool_file *file, struct index_header *header);

/* Close the file unchanged; the next program that opens the pool finishes it. */
void pool_release(struct pool_file *file);

/* Close the file as free: nothing was recorded. */
void pool_give_back(struct pool_file *file);

/* How much more can be recorded. */
struct free_space {
    uint64_t free;     /* free bytes of the file system */
    uint64_t usable;   /* bytes for recordings: of the free ones, and of the pool's files without a recording */
    uint64_t prepared; /* bytes of these files of the pool, which are not free */
    uint32_t ready;    /* prepared files of the pool, including one that has just been begun */
};

/* For a folder, or the file system of a file. Takes no lock, and waits for nothing but the disk. 0 or -errno. */
int free_space_look(const char *place, struct free_space *room);

#endif
