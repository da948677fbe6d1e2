/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A file of a recording, as it was found. */
#ifndef DDXVIDEO_FOUND_H
#define DDXVIDEO_FOUND_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

/* In this order one file's state becomes that of its recording: the last one wins. */
enum found_state {
    FOUND_FINISHED,
    FOUND_RECOVERED,   /* finished by a later recorder, after its last whole frame */
    FOUND_CUT_OFF,     /* without an index: its last frame is not whole, or is still being written */
    FOUND_INTERRUPTED, /* it has no writer, and no recorder has finished it yet */
    FOUND_RECORDING
};

/* A file of a recording. */
struct found {
    char name[NAME_MAX + 1];  /* the one that it has, or will have */
    char shown[NAME_MAX + 1]; /* the same as found_clean() leaves it, for lines that people read */
    char item[128];
    uint32_t number;  /* of the file */
    uint32_t session; /* number of the first file of its recording */
    enum found_state state;
    long id;     /* in the pool; 0: it has no index */
    bool spoilt; /* it had one */
    uint64_t recording; /* random number in its index: another one is another recording */
    uint64_t frames, bytes;
    uint64_t lost_store, lost_ring; /* as its index says */
    int64_t wall;                   /* of the first frame, ns; 0: unknown */
    int64_t duration;               /* ns */
};

#endif
