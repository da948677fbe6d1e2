/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "pace.h"

#include <time.h>

static const double LOOK = 0.25, RATE = 1, LONGEST = 60; /* s: between looks, to measure a rate over, of a wait */

double pace_now(void) {
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec / 1e9;
}

void pace_sleep(double seconds) {
    const time_t whole = (time_t)seconds;

    nanosleep(&(struct timespec){.tv_sec = whole, .tv_nsec = (long)((seconds - (double)whole) * 1e9)}, NULL);
}

/* Whether more than a second of the frames that this program takes wait for the disk. */
static bool is_late(const struct counter *now, const struct frames *then, double passed) {
    const struct counter *was = frames_find(then, now->name);

    return was && (double)now->waiting * passed > (double)(now->taken - was->taken);
}

static void look(struct pace *pace, double now) {
    struct frames frames;

    frames_look(&frames);
    pace->looked = now;
    pace->late = false;
    for (unsigned i = 0; i < frames.count && pace->then_at > 0; i++)
        if (frames.list[i].kind != GRABBER && frames.list[i].waiting > 1 &&
            is_late(&frames.list[i], &pace->then, now - pace->then_at))
            pace->late = true;
    if (!(now - pace->then_at < RATE)) {
        pace->then = frames;
        pace->then_at = now;
    }
}

void pace_rest(struct pace *pace, double took) {
    pace_sleep(took);
    for (double begin = pace_now(), now = begin; now - begin < LONGEST; now = pace_now()) {
        if (now - pace->looked >= LOOK)
            look(pace, now);
        if (!pace->late)
            return;
        pace_sleep(LOOK);
    }
}
