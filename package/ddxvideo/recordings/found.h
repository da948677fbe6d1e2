/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Facts on a file of a recording. */
#ifndef DDXVIDEO_FOUND_H
#define DDXVIDEO_FOUND_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

/* A recording has the last of its files' states, in this order. */
enum found_state {
    FOUND_FINISHED,
    FOUND_RECOVERED,   /* finished by a later recorder, after the last complete frame */
    FOUND_CUT_OFF,     /* without an index: the last frame is incomplete, or still being written */
    FOUND_INTERRUPTED, /* no recorder writes it, and none has finished it yet */
    FOUND_RECORDING
};

struct found {
    char name[NAME_MAX + 1];  /* its name now, or when it is finished */
    char shown[NAME_MAX + 1]; /* the name as found_clean() makes it, for messages */
    char item[128];
    uint32_t number;  /* of the file */
    uint32_t session; /* number of the first file of its recording */
    enum found_state state;
    long id;     /* in the pool; 0: no index */
    bool spoilt; /* its index is damaged */
    uint64_t recording; /* random number in its index, different for each recording */
    uint64_t frames, bytes;
    uint64_t lost_store, lost_ring; /* from its index */
    int64_t wall;                   /* of the first frame, ns; 0: unknown */
    int64_t duration;               /* ns */
};

#endif
