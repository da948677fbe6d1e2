/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Finishes recordings that a recorder left unfinished. */
#ifndef DDXVIDEO_POOL_RECOVER_H
#define DDXVIDEO_POOL_RECOVER_H

#include "pool_files.h"

/* Finish all of them; waits for the disk. 0, or the first -errno. */
int pool_recover(struct pool *pool);

/*
 * How many frames with numbers above `above` are in those of the newest files of this instance that a later recorder
 * finished; after pool_recover(), that is each file whose own recorder was killed.
 */
uint64_t pool_recovered_frames(struct pool *pool, uint64_t above);

#endif
