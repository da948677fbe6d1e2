/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The screen, as often as there is one: what keeps it from being used is said once, and it is tried again. */
#ifndef DDXVIDEO_PLAY_MONITOR_H
#define DDXVIDEO_PLAY_MONITOR_H

#include <stdint.h>

#include "screen.h"

/* `choice` is set, the rest 0 at first. */
struct monitor {
    struct screen_choice choice;
    struct surface *surface; /* NULL: none now */
    int64_t tried;           /* when, ns of CLOCK_MONOTONIC */
    char said[256];          /* why there is none */
};

/* Whether there is a screen now; tries to open one, twice a second at most. */
bool monitor_ready(struct monitor *monitor);

/* The screen is lost for this reason. */
void monitor_lose(struct monitor *monitor, const char *reason);

void monitor_close(struct monitor *monitor);

#endif
