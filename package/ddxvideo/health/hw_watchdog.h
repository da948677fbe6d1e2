/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The hardware watchdog: it resets the machine unless it is fed. It cannot be stopped once it is open. */
#ifndef DDXHEALTH_HW_WATCHDOG_H
#define DDXHEALTH_HW_WATCHDOG_H

struct hw_watchdog {
    const char *path;
    int file; /* -1: not open */
    int timeout; /* seconds, as set in the hardware */
};

/* Open it. If it is missing, try again: its driver may be loaded later. 0 if it is open, otherwise -errno. */
int hw_watchdog_open(struct hw_watchdog *watchdog, int timeout);

void hw_watchdog_feed(const struct hw_watchdog *watchdog);

#endif
