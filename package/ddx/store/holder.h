/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Two processes make a store: the worker does all the work, and the holder starts the next one when it has died or
 * hangs. Holder and worker share one table of descriptors (CLONE_FILES), so sockets, memory files and locks are open as
 * long as either lives; what the worker knew is kept (checkpoint.h). Its clients notice nothing.
 */
#ifndef STORE_HOLDER_H
#define STORE_HOLDER_H

/* Returns the exit status when the program was told to end. `work` is the worker, and gives its exit status. */
int holder_run(int (*work)(void));

/* By the worker, at least once a second, or it is taken to hang. */
void holder_beat(void);

/*
 * By the worker: the client (a socket) whose request it handles from now on, -1: none. A client that has cost three
 * workers their lives is not served any more: the next worker finds it here, -1: none.
 */
void holder_serving(int socket);
int holder_banned(void);

/* How many workers there were before this one. */
unsigned holder_restarts(void);

#endif
