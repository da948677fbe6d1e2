/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "schedule.h"

#include <string.h>

#include "ddx_time.h"

#define SECONDS_MAX UINT64_C(9000000000) /* 285 years, in ns just below 2^63 */

int64_t schedule_scale(int64_t a, uint32_t b, uint32_t c) {
    int64_t whole = a / c;

    if (b && whole > (INT64_MAX - UINT32_MAX) / b)
        return INT64_MAX;
    uint64_t rest = (uint64_t)(a % c) * b / c; /* below 2^64, as both factors are below 2^32; quotient below 2^32 */
    return whole * b + (int64_t)rest;
}

int64_t schedule_offset(uint64_t index, uint32_t num, uint32_t den) {
    /* index = a * num + b: a * den whole seconds, and b * den / num, split again into seconds and the rest */
    uint64_t a = index / num, part = index % num * den;
    uint64_t seconds = part / num, rest = part % num;
    if (a > SECONDS_MAX / den || a * den + seconds > SECONDS_MAX)
        return INT64_MAX;
    return (int64_t)((a * den + seconds) * SECOND + rest * SECOND / num);
}

bool schedule_parse_speed(const char *text, struct schedule_speed *speed) {
    uint64_t value = 0;
    uint32_t den = 1;
    bool digits = false, decimals = false;

    for (; *text; text++) {
        if (*text == '.' && !decimals) {
            decimals = true;
            continue;
        }
        if (*text < '0' || *text > '9' || den == SECOND / 1000 || value > UINT32_MAX)
            return false;
        value = value * 10 + (uint64_t)(*text - '0');
        digits = true;
        if (decimals)
            den *= 10;
    }
    if (!digits || value > UINT64_C(1000) * den)
        return false;
    speed->num = (uint32_t)value;
    speed->den = den;
    return true;
}

void schedule_init(struct schedule *schedule, uint32_t rate_num, uint32_t rate_den) {
    memset(schedule, 0, sizeof *schedule);
    schedule->rate_num = rate_num;
    schedule->rate_den = rate_den;
    schedule->period = schedule_offset(1, rate_num, rate_den);
}

int64_t schedule_next(struct schedule *schedule, int64_t recorded) {
    int64_t offset;

    if (recorded >= 0) {
        if (!schedule->recorded)
            schedule->base = recorded;
        schedule->recorded = true;
        offset = recorded > schedule->base ? recorded - schedule->base : 0;
    } else if (schedule->recorded) {
        offset = schedule->latest + schedule->period;
    } else {
        /* The index continues from pass to pass, so that rounding errors do not add up. */
        offset = schedule_offset(schedule->index++, schedule->rate_num, schedule->rate_den);
    }
    if (offset > schedule->latest)
        schedule->latest = offset;
    return offset > INT64_MAX - schedule->pass ? INT64_MAX : schedule->pass + offset;
}

int64_t schedule_catch_up(const struct schedule_pace *pace, int64_t due) {
    if (!pace->begun || due <= pace->due)
        return due;
    int64_t step = (due - pace->due) / 2;
    int64_t soonest = step > INT64_MAX - pace->published ? INT64_MAX : pace->published + step;
    return due > soonest ? due : soonest;
}

void schedule_loop(struct schedule *schedule) {
    if (schedule->recorded) {
        schedule->pass += schedule->latest + schedule->period;
        schedule->latest = 0;
    }
}
