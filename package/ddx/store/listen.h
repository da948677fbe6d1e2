/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef STORE_LISTEN_H
#define STORE_LISTEN_H

#include <stdbool.h>
#include <stddef.h>

/*
 * Open a listening socket for this port; its path goes into `path`. *restarted: a store ran here before, so there may
 * be living holders of items. -EADDRINUSE: a store runs here now.
 */
int listen_on(int port, char *path, size_t bytes, bool *restarted);

#endif
