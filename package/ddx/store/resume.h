/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Begin of a worker, as the first or as a successor. */
#ifndef STORE_RESUME_H
#define STORE_RESUME_H

#include "state.h"

void store_memory(void);                                    /* keep queued messages in checkpointed memory */
struct store *store_begin(const struct settings *settings); /* the first worker's state; NULL: no memory */
struct store *store_take_over(void);                        /* the previous worker's state */

#endif
