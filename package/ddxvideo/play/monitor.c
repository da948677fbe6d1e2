/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "monitor.h"

#include <ddx.h>
#include <stdio.h>
#include <string.h>

#include "program.h"

#define AGAIN INT64_C(500000000) /* ns */

static void complain(struct monitor *monitor, const char *reason) {
    if (strcmp(monitor->said, reason) != 0)
        say("%s; trying again", reason);
    snprintf(monitor->said, sizeof monitor->said, "%s", reason);
}

bool monitor_ready(struct monitor *monitor) {
    int64_t now = ddx_time_now();
    const char *error;

    if (monitor->surface)
        return true;
    if (monitor->tried && now - monitor->tried < AGAIN)
        return false;
    monitor->tried = now;
    monitor->surface = screen_open(&monitor->choice, &error);
    if (!monitor->surface) {
        complain(monitor, error);
        return false;
    }
    say("shown at %s", screen_name(monitor->surface));
    *monitor->said = 0;
    return true;
}

void monitor_lose(struct monitor *monitor, const char *reason) {
    complain(monitor, reason);
    monitor_close(monitor);
    monitor->tried = ddx_time_now();
}

void monitor_close(struct monitor *monitor) {
    surface_close(monitor->surface);
    monitor->surface = NULL;
}
