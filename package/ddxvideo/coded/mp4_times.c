/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "mp4_times.h"

#include "mp4_write.h"

#define GAP_NS ((int64_t)MP4_STEP_MAX * 1000)

int64_t mp4_between(int64_t from, int64_t to) {
    int64_t result;

    return __builtin_sub_overflow(to, from, &result) ? (to > from ? INT64_MAX : INT64_MIN) : result;
}

bool mp4_times_is_gap(const struct mp4_times *times, int64_t time) {
    return times->begun && mp4_between(times->last, time) > GAP_NS;
}

uint32_t mp4_times_next(struct mp4_times *times, int64_t time) {
    uint64_t before = times->shown, shown;

    times->last = time;
    if (!times->begun) {
        *times = (struct mp4_times){.begun = true, .base = time, .last = time};
        return 0;
    }
    int64_t us = mp4_between(times->base, time) / 1000;
    shown = us < 0 ? 0 : (uint64_t)us;
    if (shown <= before || shown - before > MP4_STEP_MAX) {
        shown = before + (shown > before ? MP4_STEP_MAX : 1);
        if (__builtin_sub_overflow(time, (int64_t)shown * 1000, &times->base))
            times->base = time > 0 ? INT64_MAX : INT64_MIN;
    }
    times->shown = shown;
    return (uint32_t)(shown - before);
}
