/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * What outlives a worker. All that it knows lies in one heap of its own. When it has done something, and before anybody
 * hears of it, it commits: the whole heap is copied beside the last copy, which counts until the new one is complete.
 * Whoever dies in the middle has done nothing. The next worker goes on from the copy, at the same addresses, so that
 * pointers are as good as before. A robot's store knows some hundred kilobytes, and a copy takes microseconds.
 *
 * Descriptors need no keeping: holder and workers have one table of them together (see holder.c).
 */
#ifndef STORE_KEPT_H
#define STORE_KEPT_H

#include <stdbool.h>
#include <stddef.h>

/* By the holder, before the first worker. 0 or -ENOMEM. */
int kept_begin(void);

/* By a worker, first: the heap as it was committed last; false: nothing was. */
bool kept_restore(void);

/* All zeros; NULL: no memory. The first one is what kept_root() gives ever after. */
void *kept_allocate(size_t bytes);
void *kept_root(void);
void kept_free(void *memory); /* or NULL */

void kept_commit(void);

#endif
