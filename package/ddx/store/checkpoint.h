/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * What outlives a worker. All that it knows lies in one heap of its own. When it has done something, and before any
 * client hears of it, it commits. There are two copies of the heap and a number that says which one counts. A commit
 * brings the other copy up to date, and then changes the number. A worker that dies in the middle has done nothing. The
 * next worker goes on from the copy, at the same addresses, so that pointers are as good as before.
 *
 * Only what has changed is copied. A page of the heap is read-only until the worker writes to it; it is then open, and
 * copied with each commit until it is closed, and once more: either copy needs it. Some pages stay open, so that the
 * heap of a small store is all open and costs no page fault. The kernel must not be asked to write into the heap:
 * a system call would fail on a page that is not open.
 *
 * What is free is given back to the system. Each process that is a client pays for the memory that it causes, up to
 * CHECKPOINT_SHARE.
 *
 * Descriptors need no keeping: holder and workers have one table of them together (see holder.c).
 */
#ifndef STORE_CHECKPOINT_H
#define STORE_CHECKPOINT_H

#include <stdbool.h>
#include <stddef.h>

/* Bytes for one account: a sixteenth of the heap for what it asks for; and more for answers that it has not read. */
#define CHECKPOINT_SHARE ((size_t)4 << 20)
#define CHECKPOINT_ANSWERS ((size_t)1 << 20)

/* What one process has caused. To be in checkpointed memory itself, as long as `bytes` is not 0. */
struct checkpoint_account {
    size_t bytes;
    bool refused; /* it was to get more than its share */
};

/* By the holder, before the first worker. 0 or -ENOMEM. */
int checkpoint_begin(void);

/* By a worker, first: the heap as it was committed last; false: nothing was. */
bool checkpoint_restore(void);

/* From now on this account pays for what is allocated; NULL: no account does. */
struct checkpoint_payer {
    struct checkpoint_account *account;
    size_t most; /* bytes that it may have then */
};
struct checkpoint_payer checkpoint_charge(struct checkpoint_account *account, size_t most); /* the former one */

/*
 * All zeros. NULL and errno: ENOMEM; EDQUOT: the account has its share already. The first one is what checkpoint_root()
 * gives ever after.
 */
void *checkpoint_allocate(size_t bytes);
void *checkpoint_root(void);
void checkpoint_free(void *memory); /* or NULL */

void checkpoint_commit(void);

/* That paid for it; NULL: none did. */
struct checkpoint_account *checkpoint_account(const void *memory);

/* Bytes that the last commit has copied. */
size_t checkpoint_copied(void);

#endif
