/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Gives a finished recording its name. */
#ifndef DDXVIDEO_POOL_FINISH_H
#define DDXVIDEO_POOL_FINISH_H

#include "index.h"
#include "pool_state.h"

/*
 * Cut the file to header->bytes, give it its name, and close it. These bytes and the index are on the disk. If another
 * file has that name, the recording gets another number, after a line. 0 or -errno.
 */
int pool_finish(struct pool *pool, struct pool_file *file, struct index_header *header);

/* As pool_finish(); `locked`: between pool_lock() and pool_unlock(). */
int pool_finish_locked(struct pool *pool, struct pool_file *file, struct index_header *header, bool locked);

#endif
