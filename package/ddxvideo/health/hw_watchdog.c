/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "hw_watchdog.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/watchdog.h>
#include <sys/ioctl.h>

int hw_watchdog_open(struct hw_watchdog *watchdog, int timeout) {
    if (watchdog->file >= 0)
        return 0;
    watchdog->file = open(watchdog->path, O_WRONLY | O_CLOEXEC);
    if (watchdog->file < 0)
        return -errno;
    watchdog->timeout = timeout;
    /* Some hardware has a fixed time, which it reports. */
    if (ioctl(watchdog->file, WDIOC_SETTIMEOUT, &watchdog->timeout))
        ioctl(watchdog->file, WDIOC_GETTIMEOUT, &watchdog->timeout);
    return 0;
}

void hw_watchdog_feed(const struct hw_watchdog *watchdog) {
    if (watchdog->file >= 0)
        ioctl(watchdog->file, WDIOC_KEEPALIVE, 0);
}
