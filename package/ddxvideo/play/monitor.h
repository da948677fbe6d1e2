/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Opens the screen again and again; each reason why it cannot be used is reported once. */
#ifndef DDXVIDEO_PLAY_MONITOR_H
#define DDXVIDEO_PLAY_MONITOR_H

#include <stdint.h>

#include "screen.h"

/* `choice` is set, the rest 0 at first. */
struct monitor {
    struct screen_choice choice;
    struct surface *surface; /* NULL: none now */
    int64_t tried;           /* time of the last attempt, ns of CLOCK_MONOTONIC */
    char said[256];          /* reason of the last failure */
};

/* Whether a screen is open; tries to open one, at most twice a second. */
bool monitor_ready(struct monitor *monitor);

/* Close the screen, which was lost for this reason. */
void monitor_lose(struct monitor *monitor, const char *reason);

void monitor_close(struct monitor *monitor);

#endif
