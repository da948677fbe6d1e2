/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXPANEL_SERVE_H
#define DDXPANEL_SERVE_H

#include "order.h"

#define SERVE_ORDERS 4 /* that run at a time */
#define SERVE_BYTES 2  /* of these, ORDER_BYTES: they run for long, and the others shall find a place */
#define SERVE_PARTS 2

struct serve {
    int web;                /* socket of the web process */
    const char *passphrase; /* NULL: no login by passphrase */
    const char *link;       /* file of a link, see login.h; NULL: no login by link */
    unsigned silence;       /* s without a sign of life of the web process, then it counts as hung; 0: for ever */
    int part[SERVE_PARTS]; /* process file descriptors of other processes without which the panel has no use; 0: none */
    int also;              /* another descriptor, and what is done when it is readable */
    void (*look)(void *argument); /* NULL: there is none */
    void *argument;
    const struct order *(*find)(const char *const *words, const char *command[ORDER_WORDS], const char **reason);
};

/*
 * Serve the web process until it exits: compare passphrases, and execute orders, each in a process of its own, so that
 * none waits for another. Reports each login and each order as a line on standard error: the address, the session, the
 * words and how it ended. 0: the web process has exited; -ECHILD: another part has; -ETIMEDOUT: the web process hangs;
 * another -errno.
 */
int serve(const struct serve *serve);

#endif
