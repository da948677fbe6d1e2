/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The panel's other processes: each is a child of root's process, as a user of its own. */
#ifndef DDXPANEL_PART_H
#define DDXPANEL_PART_H

#include <sys/types.h>

struct part {
    const char *name; /* for messages */
    const char *user;
    long group;                 /* -1: the user's own */
    const char *const *empty;   /* folders that it sees empty; ends with NULL */
    int (*run)(void *argument); /* its program; what it returns is a reason to report, -errno */
    void *argument;
};

/*
 * Start a process with the user's rights, without capabilities and without a way to get any, that is killed when this
 * one exits. Returns a descriptor of the process, which is readable once it has exited; or -errno.
 */
int part_start(const struct part *part);

#endif
