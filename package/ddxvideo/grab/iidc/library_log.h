/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What libdc1394 says, as lines of ours: each once, as long as the camera is away. */
#ifndef DDXVIDEO_LIBRARY_LOG_H
#define DDXVIDEO_LIBRARY_LOG_H

#include <stdbool.h>

void library_log_begin(void);

/* Say nothing, or go on: where a failure is expected, or gets a line of ours. Returns how many lines were not said. */
unsigned library_log_mute(bool mute);

/* The camera is there: what was said so far is news when it is said again. */
void library_log_forget(void);

#endif
