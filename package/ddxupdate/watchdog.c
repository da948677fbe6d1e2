/* SPDX-License-Identifier: GPL-2.0-or-later */
/* In a trial the watchdog begins before the services do. ddxhealth takes it over; until then it is not fed, so a boot
 * that hangs is reset. */
#include <errno.h>
#include <fcntl.h>
#include <linux/watchdog.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "command.h"
#include "decide.h"
#include "place.h"

int command_watchdog(const struct request *request) {
    struct rules rules;
    const int watchdog = open(request->boot, O_WRONLY | O_CLOEXEC);

    if (watchdog < 0)
        return fail(1, "%s: %s; a boot that hangs will not be reset", request->boot, strerror(errno));
    rules_read(&rules, &request->place);
    int seconds = (int)rules.watchdog;
    /* Hardware with a fixed or shorter time keeps that. */
    if (ioctl(watchdog, WDIOC_SETTIMEOUT, &seconds))
        fail(0, "%s: its time cannot be set to %d s: %s", request->boot, seconds, strerror(errno));
    ioctl(watchdog, WDIOC_KEEPALIVE, 0);
    close(watchdog); /* without the letter that would stop it */
    return 0;
}
