/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "pace.h"

#include <stdlib.h>

/* ---- Wall time ---- */

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

/* ---- Pace ---- */

#define PHASE_SHARE 8    /* a frame's delay moves the next frame's expected time by this fraction of it */
#define PERIOD_SHARE 128 /* and the period by this fraction, since the camera has a clock of its own */
#define CYCLES 64000     /* until they wrap */
#define CYCLE_NS 125000
#define WRAP_NS ((int64_t)CYCLES * CYCLE_NS)
#define ODD_NS INT64_C(1000000000)
#define ALIKE_SHARE 8 /* steps that differ by less than this fraction are alike */

void pace_restart(struct pace *pace, int64_t period) {
    *pace = (struct pace){.period = period, .number = pace->number};
}

static void learn(struct pace *pace, int64_t time) {
    int64_t step = pace->last ? time - pace->last : 0;

    if (step <= 0 || llabs(step - pace->step) > pace->step / ALIKE_SHARE) {
        pace->step = step > 0 ? step : 0;
        pace->since = time;
        pace->alike = 0;
    } else if (++pace->alike == PACE_ALIKE) {
        pace->period = (time - pace->since) / PACE_ALIKE;
    }
}

/* The number of periods that have passed. Corrects the clock by the frame's delay. */
static void count_by_clock(struct pace *pace, int64_t time) {
    int64_t steps = (time - pace->due + pace->period / 2) / pace->period;

    if (steps < 1) /* the frame follows a delay */
        return;
    int64_t late = time - pace->due - steps * pace->period;
    pace->due += steps * pace->period + late / PHASE_SHARE;
    pace->period += late / steps / PERIOD_SHARE;
    pace->counted += (uint32_t)steps;
}

uint32_t pace_number(struct pace *pace, int64_t time, bool more) {
    bool known = pace->period > 0 && pace->last;

    if (known && !more)
        count_by_clock(pace, time);
    int32_t ahead = (int32_t)(pace->counted - pace->number);
    pace->number += known && ahead > 1 ? (uint32_t)ahead : 1;
    if (!known) {
        if (!pace->period)
            learn(pace, time);
        pace->due = time;
        pace->counted = pace->number;
    }
    pace->last = time;
    return pace->number;
}

/* The bus time since the last frame; `passed` is that time by the library's clock. */
static int64_t bus_step(const struct pace *pace, uint32_t cycle, int64_t passed) {
    int64_t step = (int64_t)((cycle + CYCLES - pace->cycle) % CYCLES) * CYCLE_NS;

    if (passed > step)
        step += (passed - step + WRAP_NS / 2) / WRAP_NS * WRAP_NS;
    if (llabs(step - passed) <= ODD_NS)
        return step;
    return passed > 0 ? passed : 0;
}

uint32_t pace_bus_number(struct pace *pace, uint32_t cycle, int64_t time) {
    pace->bus = pace->cycle ? pace->bus + bus_step(pace, cycle, time - pace->host) : time;
    pace->cycle = cycle;
    pace->host = time;
    return pace_number(pace, pace->bus, false);
}
