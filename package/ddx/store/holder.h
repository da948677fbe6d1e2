/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A store consists of two processes: the worker does all the work, and the holder starts the next worker after one has
 * died or hangs. Holder and worker share one descriptor table (CLONE_FILES), so sockets, memory files and locks remain
 * open while either lives; the worker's state is checkpointed (checkpoint.h). Clients do not notice the change.
 */
#ifndef STORE_HOLDER_H
#define STORE_HOLDER_H

/* Run workers until a request to stop; returns the exit status. `work` is the worker; it returns its exit status. */
int holder_run(int (*work)(void));

/* By the worker, at least once a second; otherwise the holder takes it to hang. */
void holder_beat(void);

/*
 * By the worker: holder_serving() names the client (a socket, -1: none) whose request is handled from now on. A client
 * whose requests killed three workers is not served again: holder_banned() returns it to the next worker, or -1.
 */
void holder_serving(int socket);
int holder_banned(void);

/* Number of workers before this one. */
unsigned holder_restarts(void);

#endif
