/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The hardware watchdog: it resets the machine unless it is fed. Once opened it cannot be called off. */
#ifndef DDXHEALTH_HW_WATCHDOG_H
#define DDXHEALTH_HW_WATCHDOG_H

struct hw_watchdog {
    const char *path;
    int file; /* -1: not there */
    int timeout; /* seconds; as the hardware took it */
};

/* Open it, if it is there: drivers may come later, so call it again. 0 when it is open, else -errno. */
int hw_watchdog_open(struct hw_watchdog *watchdog, int timeout);

void hw_watchdog_feed(const struct hw_watchdog *watchdog);

#endif
