/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Commands to a running recorder (ddx_request.h, item: the recorder's instance; `ddxctl record`):
 *
 *     recording=0   stop: frames are left out, and counted as skipped;  recording=1   continue, in a new file
 *     split=1       the next frame begins a new recording; no frame is lost
 *     pre_roll=N    while it is stopped, keep the last N seconds in memory, and record them first when it continues
 */
#ifndef DDXVIDEO_COMMANDS_H
#define DDXVIDEO_COMMANDS_H

#include "recorder_state.h"

#define PRE_ROLL_MAX 600 /* s */

/* Takes commands from now on; if the store has no memory for that, a line reports it. */
void commands_open(struct recorder *recorder, DDX_STORE_ID *id);

/* Carries out the next command, if there is one. Waits only for a former recording that is still being written. */
void commands_tick(struct recorder *recorder);

void commands_close(struct recorder *recorder);

#endif
