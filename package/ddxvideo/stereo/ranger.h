/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * From a pair to what the program writes: items NAME (three fields: right, range, left), NAME.disparity and
 * NAME.stereo.
 */
#ifndef DDXVIDEO_STEREO_RANGER_H
#define DDXVIDEO_STEREO_RANGER_H

#include "calibration.h"
#include "matcher.h"
#include "rectifier.h"
#include "source.h"

struct ranger {
    /* Set before ranger_run(): */
    const char *name;
    const char *calibration_path;
    struct calibration calibration;
    struct matcher_settings settings; /* width and height are set by ranger_run() */
    /* Its own, 0 at first: */
    struct ddxvideo_geometry eye; /* what it is made for; width 0: nothing yet */
    struct rectifier *rectifier[2];
    struct matcher *matcher;
    DDX_STORE_ITEM *range, *disparity, *stereo;
    bool refused; /* a line has said so */
    uint8_t level[256];
};

/*
 * 0; -EINVAL, the pair does not fit the calibration or the method, after a line for the first of such pairs; else an
 * error of the store or of memory, which is final but for -ENOBUFS (readers hold all that there is).
 */
int ranger_run(struct ranger *ranger, DDX_STORE_ID *id, const struct pair *pair);

void ranger_close(struct ranger *ranger);

#endif
