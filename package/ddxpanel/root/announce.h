/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Makes the machine findable by its name: runs mdnsd, which answers for <host name>.local and announces the panel, and
 * a program that shows the addresses. Both again after each change of addresses: mdnsd 0.12 itself has no record for
 * an address that came after its start.
 */
#ifndef DDXPANEL_ANNOUNCE_H
#define DDXPANEL_ANNOUNCE_H

#include <stdint.h>

#include "part.h"

struct announce {
    const struct part *mdnsd;
    const char *show;   /* path of a program without words; it is not waited for */
    int watch;          /* socket: addresses have changed */
    int timer;          /* it is time to look at them, or to start mdnsd again */
    int process;        /* process file descriptor of mdnsd; -1: it does not run */
    uint64_t addresses; /* that mdnsd was started with: address_sum() */
    int64_t begin;      /* ms, when it was started */
    int64_t pause;      /* ms until it is started again after it has exited */
    int events;         /* epoll: one of these three is readable */
};

/* `mdnsd` and `show` as above. Returns a descriptor; announce_look() is due when it is readable. Or -errno. */
int announce_open(struct announce *announce, const struct part *mdnsd, const char *show);

/* Does what is due, and does not wait for anything. */
void announce_look(void *announce);

#endif
