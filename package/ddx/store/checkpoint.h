/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Checkpointed memory: state that outlives a worker. All state of the worker is in one heap. After each action, and
 * before any client hears of it, the worker commits. There are two copies of the heap, and a number selects the valid
 * one. A commit updates the other copy, and then changes the number, so a worker that dies during a commit leaves the
 * last state. The next worker restores the heap from the copy, at the same addresses, so pointers remain valid.
 *
 * Only changed pages are copied. A page of the heap is read-only until the worker writes to it; then it is open: each
 * commit copies it until it is closed, and once more after that, because both copies need it. Some pages stay open, so
 * that the heap of a small store is completely open and causes no page faults. System calls must not write into the
 * heap: they fail on a page that is not open.
 *
 * Free memory is returned to the system. Each client process is charged for the memory that it causes, up to
 * CHECKPOINT_SHARE.
 *
 * Descriptors need no checkpoint: holder and workers share one descriptor table (see holder.c).
 */
#ifndef STORE_CHECKPOINT_H
#define STORE_CHECKPOINT_H

#include <stdbool.h>
#include <stddef.h>

/* Bytes for one account: a sixteenth of the heap for its requests, and more for answers that it has not read. */
#define CHECKPOINT_SHARE ((size_t)4 << 20)
#define CHECKPOINT_ANSWERS ((size_t)1 << 20)

/* The memory charged to one process. Must be in checkpointed memory itself while `bytes` is not 0. */
struct checkpoint_account {
    size_t bytes;
    bool refused; /* an allocation beyond its share was refused */
};

/* By the holder, before the first worker. 0 or -ENOMEM. */
int checkpoint_begin(void);

/* By a worker, first: restore the heap as it was last committed. False: there was no commit. */
bool checkpoint_restore(void);

/* Charge later allocations to this account (NULL: none), as long as it has at most `most` bytes. Returns the former. */
struct checkpoint_payer {
    struct checkpoint_account *account;
    size_t most;
};
struct checkpoint_payer checkpoint_charge(struct checkpoint_account *account, size_t most);

/*
 * All zeros. NULL and errno: ENOMEM; EDQUOT: the account has its share already. checkpoint_root() returns the first
 * allocation, in later workers too.
 */
void *checkpoint_allocate(size_t bytes);
void *checkpoint_root(void);
void checkpoint_free(void *memory); /* or NULL */

void checkpoint_commit(void);

/* The account that is charged for this memory, or NULL. */
struct checkpoint_account *checkpoint_account(const void *memory);

/* Bytes that the last commit copied. */
size_t checkpoint_copied(void);

#endif
