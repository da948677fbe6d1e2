/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "frame_count.h"

#define TIME_OFF_NS INT64_C(2000000000)
#define MEASURED 16 /* frames */

void count_restart(struct count *count) {
    count->running = count->measured = false;
    count->since = 0;
}

uint64_t count_pass(struct count *count, uint64_t frames) {
    uint64_t before = (count->position + count->skip - 1) / count->skip; /* wanted frames before the position */

    count->position += frames;
    return (count->position + count->skip - 1) / count->skip - before;
}

uint64_t count_frame(struct count *count, uint32_t sequence, bool *wanted, uint64_t *position) {
    uint32_t step = sequence - count->sequence;
    uint64_t gap = count->running && step && step < UINT32_C(1) << 31 ? step - 1 : 0;

    count->sequence = sequence;
    count->running = true;
    count->lost += gap;
    uint64_t lost = count_pass(count, gap);
    *position = count->position;
    *wanted = count_pass(count, 1) == 1;
    return lost;
}

int64_t count_period(struct count *count, uint64_t position, int64_t time, int64_t period) {
    uint64_t frames = count->since ? position - count->from : 0;

    if (frames && time > count->since && (frames >= MEASURED || !count->measured))
        period = (time - count->since) / (int64_t)frames;
    if (!frames || frames >= MEASURED) {
        count->measured = frames > 0;
        count->since = time;
        count->from = position;
    }
    return period;
}

int64_t count_time(int64_t said, int64_t opened, int64_t now) {
    return said && said > opened - TIME_OFF_NS && said < now + TIME_OFF_NS ? said : now;
}
