/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A video item into files. */
#ifndef DDXVIDEO_RECORDER_H
#define DDXVIDEO_RECORDER_H

#include "recorder_state.h"

/* Record until told to stop; returns the program's exit status. */
int recorder_run(struct recorder *recorder);

#endif
