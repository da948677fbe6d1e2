/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The frames of grabbers, recorders and loggers, by the counters that each program keeps in the store. */
#ifndef DDXUPDATE_FRAMES_H
#define DDXUPDATE_FRAMES_H

#include <stdint.h>

#include "place.h"

enum { COUNTERS_MAX = 16 };

struct counter {
    char name[WORD_MAX]; /* of the instance */
    enum { GRABBER, RECORDER, LOGGER } kind;
    uint64_t taken;   /* frames in */
    uint64_t passed;  /* a grabber's frames in, a recorder's or logger's frames out */
    uint64_t waiting; /* not on the disk yet */
    uint64_t lost;    /* for any reason */
};

struct frames {
    bool answered; /* the store has, within five seconds */
    struct counter list[COUNTERS_MAX];
    unsigned count;
};

void frames_look(struct frames *frames);

/* The counters of an instance; NULL: there are none. */
const struct counter *frames_find(const struct frames *frames, const char *name);

#endif
