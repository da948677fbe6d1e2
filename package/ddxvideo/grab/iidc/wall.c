/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "wall.h"

#define FUTURE_NS INT64_C(1000000) /* the two clocks are read one after the other, ns */

/* Distance from now; the future counts as farther than any past. */
static int64_t distance(int64_t time, int64_t now) {
    return time <= now + FUTURE_NS ? now + FUTURE_NS - time : INT64_MAX;
}

int64_t wall_time(struct wall *wall, uint64_t us, int64_t now, int64_t offset) {
    int64_t real = (int64_t)(us % (INT64_MAX / 1000)) * 1000;
    int64_t by_now = real - offset, by_last = real - (wall->offset ? wall->offset : offset);

    wall->offset = offset;
    if (!us)
        return 0;
    return distance(by_last, now) < distance(by_now, now) ? by_last : by_now;
}
