/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXPANEL_CLOCK_H
#define DDXPANEL_CLOCK_H

#include <stdint.h>
#include <time.h>

/* ms of a clock that is never set, and goes on while the machine sleeps. */
static inline int64_t clock_ms(void) {
    struct timespec now;

    clock_gettime(CLOCK_BOOTTIME, &now);
    return (int64_t)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

#endif
