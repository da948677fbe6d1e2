/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Descriptors that the store knows of. Messages that wait to be sent use them without a copy of their own, and none is
 * closed before the next commit: until then the last one may speak of it, and it is what counts should this worker die.
 */
#ifndef STORE_FILES_H
#define STORE_FILES_H

#include <stdbool.h>
#include <stdint.h>

struct file {
    uint16_t users; /* messages */
    bool closed;    /* but for them */
};

/* By descriptor: which are in use, by how many messages. Kept memory. */
struct files {
    struct file *file;
    unsigned count;
};

/* By a worker, first: where that stands. */
void files_use_table(struct files *files);

/* A message needs it. 0 or -ENOMEM. */
int file_use(int fd);
void file_unuse(int fd);

/* Not needed otherwise: closed when no message needs it, and after the next commit. */
void file_close(int fd);

/* Commits the state (checkpoint.h), then closes the descriptors that are no longer needed. */
void files_commit(void);

/*
 * By a worker that takes over: `known` reports whether the committed state uses a descriptor. An unknown connection
 * was accepted by a worker that died before its commit: `found` gets it. Others are closed.
 */
void files_sweep(bool (*known)(int fd), void (*found)(void *context, int socket), void *context);

/* By the holder, before the first worker: what is open now is not ours. */
void files_begin(void);

#endif
