/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Closed recordings that are still being written: the thread that takes frames does not wait for them. */
#ifndef DDXVIDEO_BACKLOG_H
#define DDXVIDEO_BACKLOG_H

#include "recording.h"

#define BACKLOG_MAX 8

struct backlog {
    struct recording *recording[BACKLOG_MAX]; /* the oldest first */
    unsigned count;
};

/*
 * Whether `present`, which may be NULL, may be added, and another recording begun whose queue has that number of bytes:
 * together they must not take all the memory, however long the disk hangs. A second recording is always allowed.
 */
bool backlog_has_room(const struct backlog *backlog, const struct recording *present, uint64_t queue_bytes);

/* Add a closed recording; backlog_has_room() returned true. */
void backlog_add(struct backlog *backlog, struct recording *recording);

/* Take out the oldest recording if it is on disk, with `wait` also if it is not. NULL if there is none. */
struct recording *backlog_take(struct backlog *backlog, bool wait);

#endif
