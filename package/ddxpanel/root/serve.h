/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXPANEL_SERVE_H
#define DDXPANEL_SERVE_H

#include "order.h"

#define SERVE_ORDERS 4 /* that run at a time */

struct serve {
    int web;                /* socket of the web process */
    const char *passphrase; /* NULL: no login by passphrase */
    const struct order *(*find)(const char *const *words, const char *command[ORDER_WORDS], const char **reason);
};

/*
 * Serve the web process until it exits: compare passphrases, and execute orders, each in a process of its own, so that
 * none waits for another. Reports each login and each order as a line on standard error: the address, the session, the
 * words and how it ended. 0, or -errno.
 */
int serve(const struct serve *serve);

#endif
