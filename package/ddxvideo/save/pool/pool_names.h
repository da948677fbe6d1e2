/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Numbers and names of recordings, and the search for the oldest. */
#ifndef DDXVIDEO_POOL_NAMES_H
#define DDXVIDEO_POOL_NAMES_H

#include "index.h"
#include "pool_files.h"

/*
 * The number in a recording's name, <item>-<number>-<UTC>.y4m or .mp4; returns the end of the item's name. NULL: no
 * number.
 */
const char *pool_name_number(const char *name, uint32_t *number);

/*
 * The number of the next recording of any item: above all numbers in use, and from now on in use for every recorder of
 * this pool.
 */
uint32_t pool_next_number(struct pool *pool);

/* Write instance, item, number, and a name with the current time into the header, whose format is set. */
void pool_name(const struct pool *pool, struct index_header *header, const char *item, uint32_t number);

/* Give up the oldest recording: its file is claimed, loses its name, and becomes INDEX_RAW. -ENOENT: there is none. */
int pool_recycle(struct pool *pool, struct pool_file *file);

/*
 * Cut the file to header->bytes, give it its name, and close it. These bytes and the index are on the disk. If another
 * file has that name, the recording gets another number, after a line. 0 or -errno.
 */
int pool_finish(struct pool *pool, struct pool_file *file, struct index_header *header);

/* As pool_finish(); `locked`: between pool_lock() and pool_unlock(). */
int pool_finish_locked(struct pool *pool, struct pool_file *file, struct index_header *header, bool locked);

#endif
