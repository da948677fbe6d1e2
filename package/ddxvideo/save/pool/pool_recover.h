/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Recordings that a recorder left unfinished. */
#ifndef DDXVIDEO_POOL_RECOVER_H
#define DDXVIDEO_POOL_RECOVER_H

#include "pool_state.h"

/* Finish unfinished recordings; waits for the disk. 0, or -errno for one that fails. */
int pool_recover(struct pool *pool);

/*
 * How many frames with numbers above that are in the newest files of this instance which were finished by a later
 * recorder, as after pool_recover() all are whose own one was killed.
 */
uint64_t pool_recovered_frames(struct pool *pool, uint64_t above);

#endif
