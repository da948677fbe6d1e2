/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Records a video item into files. */
#ifndef DDXVIDEO_RECORDER_H
#define DDXVIDEO_RECORDER_H

#include "recorder_frames.h"

#define PRE_ROLL_MAX 600 /* s */

/* Record until a stop is requested. Returns the exit status. */
int recorder_run(struct recorder *recorder);

#endif
