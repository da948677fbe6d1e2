/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Recordings that have ended and are still being written: the thread that takes frames does not wait for them. */
#ifndef DDXVIDEO_BACKLOG_H
#define DDXVIDEO_BACKLOG_H

#include "recording.h"

#define BACKLOG_MAX 8

struct backlog {
    struct recording *recording[BACKLOG_MAX]; /* the oldest first */
    unsigned count;
};

/*
 * Whether `present`, which may be NULL, may be added and another one be begun, whose queue has that number of bytes:
 * together they must not take all the memory, however long the disk hangs. A second one is always allowed.
 */
bool backlog_has_room(const struct backlog *backlog, const struct recording *present, uint64_t queue_bytes);

/* It is closed; there was room. */
void backlog_add(struct backlog *backlog, struct recording *recording);

/* The oldest one, out of the backlog, if it is on disk; with `wait` also if it is not. NULL if there is none. */
struct recording *backlog_take(struct backlog *backlog, bool wait);

#endif
