/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A recording gets its name. */
#ifndef DDXVIDEO_POOL_FINISH_H
#define DDXVIDEO_POOL_FINISH_H

#include "index.h"
#include "pool_state.h"

/*
 * The recording in the file has header->bytes bytes, which are on the disk, as is its index: cut it, give it its name,
 * close it. Where another file has that name, the recording gets another number, after a line. 0 or -errno.
 */
int pool_finish(struct pool *pool, struct pool_file *file, struct index_header *header);

/* As pool_finish(); `locked`: between pool_lock() and pool_unlock(). */
int pool_finish_locked(struct pool *pool, struct pool_file *file, struct index_header *header, bool locked);

#endif
