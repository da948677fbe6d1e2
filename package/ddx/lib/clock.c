/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include <time.h>

#include "ddx.h"
#include "hot.h"

DDX_HOT DDX_TIME ddx_time_now(void) {
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (DDX_TIME)now.tv_sec * 1000000000 + now.tv_nsec;
}
