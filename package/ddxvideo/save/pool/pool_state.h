/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What the parts of the pool share. */
#ifndef DDXVIDEO_POOL_STATE_H
#define DDXVIDEO_POOL_STATE_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#define POOL_FOLDER "pool"
#define POOL_PATH 32 /* room for the name of a file in the pool */
#define POOL_ID_MAX 999999999L /* highest number of a file: fits a long, and a name */
#define POOL_READY 2 /* files that are kept ready */
#define POOL_LEFT_FREE (16u << 20) /* bytes of the disk, for logs, and what the file system needs for itself */

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

#endif
