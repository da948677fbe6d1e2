/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Descriptors that the store knows of. Messages that wait to be sent use them without a copy of their own, and none is
 * closed before the next commit: until then the last one may speak of it, and it is what counts should this worker die.
 */
#ifndef STORE_FILES_H
#define STORE_FILES_H

#include <stdbool.h>

/* A message needs it. 0 or -ENOMEM. */
int file_use(int fd);
void file_unuse(int fd);

/* Nobody else needs it: it is closed when no message does, and after the next commit. */
void file_close(int fd);

/* After a commit. */
void files_close(void);

/*
 * By a worker that takes over: `known` tells whether a descriptor is in use by what was committed. A connection that
 * nobody knows of was taken in by a worker that died before it could say so: `found` gets it. Others are closed.
 */
void files_sweep(bool (*known)(int fd), void (*found)(int socket));

/* By the holder, before the first worker: what is open now is not ours. */
void files_begin(void);

#endif
