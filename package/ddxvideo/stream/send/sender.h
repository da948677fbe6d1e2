/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Sends a video item as a stream. */
#ifndef DDXVIDEO_SENDER_H
#define DDXVIDEO_SENDER_H

#include "sender_state.h"

/* Send until a stop is requested. Returns the exit status. */
int sender_run(struct sender *sender);

#endif
