/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Descriptors of the store. Messages that wait to be sent use them without a copy of their own. No descriptor is closed
 * before the next commit: the last committed state may refer to it, and is restored if this worker dies.
 */
#ifndef STORE_FILES_H
#define STORE_FILES_H

#include <stdbool.h>
#include <stdint.h>

struct file {
    uint16_t users; /* number of messages */
    bool closed;    /* to be closed when no message uses it */
};

/* Indexed by descriptor. In checkpointed memory. */
struct files {
    struct file *file;
    unsigned count;
};

/* By a worker, first: use this table. */
void files_use_table(struct files *files);

/* A message uses the descriptor. 0 or -ENOMEM. */
int file_use(int fd);
void file_unuse(int fd);

/* Close the descriptor after the next commit, and when no message uses it. */
void file_close(int fd);

/* Commit the state (checkpoint.h), then close the descriptors that are no longer needed. */
void files_commit(void);

/*
 * By a worker that takes over: `known` reports whether the committed state uses a descriptor. An unknown connection
 * was accepted by a worker that died before its commit: `found` gets it. Other unknown descriptors are closed.
 */
void files_sweep(bool (*known)(int fd), void (*found)(void *context, int socket), void *context);

/* By the holder, before the first worker: descriptors that are open now are not the store's. */
void files_begin(void);

#endif
