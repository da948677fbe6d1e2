/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Several replays of one run: `ddxlog -replay` writes the start of the run into an item, and other replays of it
 * (ddxvideoload) follow that. A value recorded at CLOCK_MONOTONIC `recorded` is replayed at `replayed`; a value
 * recorded t later is replayed t * den / num later.
 */
#ifndef DDX_REPLAY_CLOCK_H
#define DDX_REPLAY_CLOCK_H

#include <ddx.h>

DDX_STORE_TYPE(
    DDX_REPLAY_CLOCK, struct {
        int64_t recorded; /* ns */
        int64_t replayed; /* ns; some time ahead when it is written */
        uint32_t num;     /* speed: num / den, both above 0 */
        uint32_t den;
    });

#endif
