/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Computes range from a pair, and writes the items NAME (three fields: right, range, left), NAME.disparity and
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
    /* Private, 0 at first: */
    struct ddxvideo_geometry eye; /* size that the tables are made for; width 0: none yet */
    struct rectifier *rectifier[2];
    struct matcher *matcher;
    DDX_STORE_ITEM *range, *disparity, *stereo;
    bool refused; /* a line has reported it */
    uint8_t level[256];
};

/*
 * 0; -EINVAL: the pair does not fit the calibration or the method, after a line for the first such pair; otherwise an
 * error of the store or of memory, which is final except for -ENOBUFS (readers hold all slots).
 */
int ranger_run(struct ranger *ranger, DDX_STORE_ID *id, const struct pair *pair);

void ranger_close(struct ranger *ranger);

#endif
