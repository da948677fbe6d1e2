/* SPDX-License-Identifier: GPL-2.0-or-later */
/* From a video item to packets of a stream. */
#ifndef DDXVIDEO_SENDER_H
#define DDXVIDEO_SENDER_H

#include "sender_state.h"

/* Send until told to stop; returns the program's exit status. */
int sender_run(struct sender *sender);

#endif
