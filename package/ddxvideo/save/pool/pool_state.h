/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Data shared by the parts of the pool. */
#ifndef DDXVIDEO_POOL_STATE_H
#define DDXVIDEO_POOL_STATE_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#define POOL_FOLDER "pool"
#define POOL_PATH 32 /* bytes for the name of a file in the pool */
#define POOL_ID_MAX 999999999L /* highest number of a file: fits a long, and a name */
#define POOL_READY 2 /* files that are kept ready */
#define POOL_LEFT_FREE (16u << 20) /* bytes of the disk, for logs and the file system itself */

/* A claimed file of the pool. */
struct pool_file {
    long id;       /* its name */
    int fd;        /* of the file, with O_DIRECT if supported */
    int index_fd;  /* of the index */
    int lock_fd;   /* locked as long as it is open */
    bool direct;
    bool prepared; /* no metadata is left to write, except changes by this program */
    uint64_t written; /* if not prepared: bytes that have been written once all the same */
};

struct pool {
    const char *place, *instance; /* arguments of pool_open() */
    int outside; /* the folder of the recordings */
    int folder;  /* the pool in it */
    int lock_fd; /* its byte 0 is locked by pool_lock() */
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

#endif
