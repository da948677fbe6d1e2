/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "dog.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/watchdog.h>
#include <sys/ioctl.h>

int dog_open(struct dog *dog, int timeout) {
    if (dog->file >= 0)
        return 0;
    dog->file = open(dog->path, O_WRONLY | O_CLOEXEC);
    if (dog->file < 0)
        return -errno;
    dog->timeout = timeout;
    /* Hardware that cannot be told keeps its own time, which it says. */
    if (ioctl(dog->file, WDIOC_SETTIMEOUT, &dog->timeout))
        ioctl(dog->file, WDIOC_GETTIMEOUT, &dog->timeout);
    return 0;
}

void dog_feed(const struct dog *dog) {
    if (dog->file >= 0)
        ioctl(dog->file, WDIOC_KEEPALIVE, 0);
}
