/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Prints libdc1394's messages as our lines: each once while the camera is away. */
#ifndef DDXVIDEO_LIBRARY_LOG_H
#define DDXVIDEO_LIBRARY_LOG_H

#include <stdbool.h>

void library_log_begin(void);

/* Mute, or continue: for failures that are expected or get a line of ours. Returns the number of omitted lines. */
unsigned library_log_mute(bool mute);

/* The camera is back: each message may be printed once more. */
void library_log_forget(void);

#endif
