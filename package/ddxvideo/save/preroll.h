/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The last seconds before the order to record: pictures that wait in memory while nothing is recorded. */
#ifndef DDXVIDEO_PREROLL_H
#define DDXVIDEO_PREROLL_H

#include "ddxvideo.h"
#include "recording.h"

struct preroll {
    int64_t seconds; /* that are wanted; 0: none */
    /* private: */
    struct ddxvideo_geometry geometry; /* of what is in it */
    struct ddxvideo_picture *picture;  /* their planes are in `memory` */
    struct recording_frame *frame;
    unsigned char *memory;
    size_t bytes; /* of each */
    unsigned limit, oldest, count;
    uint64_t missed; /* since the newest */
};

/*
 * How many seconds of such pictures it can have: three quarters of a queue of that number of frames, which takes them.
 */
int64_t preroll_seconds_max(const struct ddxvideo_geometry *geometry, unsigned queue_frames);

/*
 * Keep a picture (it is copied), and let go of those that are too old by now; of all, if they were of another kind.
 * Returns how many frames were let go of, those that were missed before them included; this one as well if there is
 * no memory for it.
 */
uint64_t preroll_put(struct preroll *preroll, unsigned queue_frames, const struct ddxvideo_picture *view,
                     const struct recording_frame *frame);

/*
 * Frames were missed before one that is not kept. After a waiting picture they are remembered, as missed
 * before the next one. Returns how many are dropped instead: all, if no picture waits.
 */
uint64_t preroll_missed(struct preroll *preroll, uint64_t frames);

/* The oldest one leaves: false if there is none. The picture stays until the next preroll_put(). */
bool preroll_take(struct preroll *preroll, struct ddxvideo_picture *view, struct recording_frame *frame);

/* After the last one: how many frames were missed after it. They are forgotten. */
uint64_t preroll_missed_last(struct preroll *preroll);

/* Let go of all; returns how many, as preroll_put(), and what was missed since. The memory is given back. */
uint64_t preroll_clear(struct preroll *preroll);

#endif
