/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef STORE_WORKER_H
#define STORE_WORKER_H

#include "state.h"

/* Run until a request to stop; returns the exit status. */
int worker_run(const struct settings *settings);

#endif
