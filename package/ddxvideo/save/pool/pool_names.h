/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Numbers and names of recordings, and which is the oldest. */
#ifndef DDXVIDEO_POOL_NAMES_H
#define DDXVIDEO_POOL_NAMES_H

#include "index.h"
#include "pool_state.h"

/* The number in a recording's name, <item>-<number>-<UTC>.y4m; returns where the item's name ends. NULL: it has no
 * number. */
const char *pool_name_number(const char *name, uint32_t *number);

/*
 * The number of the next recording, whatever item it is of: above all that there are, and taken from now on for every
 * recorder of this pool.
 */
uint32_t pool_next_number(struct pool *pool);

/* As pool_next_number(), between pool_lock() and pool_unlock(). */
uint32_t pool_take_number(struct pool *pool);

/* Write instance, item, number and name, which has the present time in it, into the header. */
void pool_name(const struct pool *pool, struct index_header *header, const char *item, uint32_t number);

/* Another number for a recording whose name another file has: in header->name, too. */
void pool_renumber(struct index_header *header, uint32_t number);

/* Give up the oldest recording: its file becomes ours, without its name, INDEX_RAW. -ENOENT: there is none. */
int pool_recycle(struct pool *pool, struct pool_file *file);

#endif
