/* SPDX-License-Identifier: GPL-2.0-or-later */
/* From one worker to the next. */
#ifndef STORE_RESUME_H
#define STORE_RESUME_H

#include "state.h"

void store_memory(void); /* queues keep their messages where they outlive the worker */
struct store *store_begin(const struct settings *settings); /* of the first worker; NULL: no memory */
struct store *store_take_over(void);                        /* from the worker before */

#endif
