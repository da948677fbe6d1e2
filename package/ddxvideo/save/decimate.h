/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Selects frames if not all are to be recorded: from the item's first one on, `take` of every `of` frames, evenly
 * spaced by their numbers in the store. So a lost frame is known to have been wanted or not, and a restarted recorder
 * continues in step with the previous one.
 */
#ifndef DDXVIDEO_DECIMATE_H
#define DDXVIDEO_DECIMATE_H

#include <stdint.h>

#include "ddxvideo.h"

struct decimate {
    /* settings, one of both: */
    long skip;                   /* one of `skip` frames; 0 or 1: each */
    uint32_t rate_num, rate_den; /* frames a second at most; rate_num 0: as many as there are */
    /* private: */
    uint32_t take, of; /* record `take` of every `of` frames; take 0: all of them; of 0: not set yet */
    int their_num, their_den, kept_num, kept_den; /* rates of the input, and of the recorded frames */
};

/*
 * Choose the frames of pictures with this geometry, by its rate; then its rate is set to that of the recording. 0;
 * -ENODATA if a rate is wanted, and that of the pictures is not known: then each frame is recorded.
 */
int decimate_look(struct decimate *decimate, struct ddxvideo_geometry *geometry);

/* How many of the frames 1 to `sequence` are wanted. */
uint64_t decimate_up_to(const struct decimate *decimate, uint64_t sequence);

/* How many of the last `frames` frames up to this one are wanted. */
uint64_t decimate_wants(const struct decimate *decimate, uint64_t sequence, uint64_t frames);

#endif
