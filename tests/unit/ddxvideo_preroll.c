/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Frames before the command to record: each is kept, dropped, or known to be missing. */
#include <stdbool.h>
#include <string.h>

#include "check.h"
#include "preroll.h"

#define QUEUE 8 /* frames; six of them wait at most */
#define SIDE 16
#define NS INT64_C(1000000000)

static unsigned char luma[SIDE * SIDE], chroma[2][SIDE * SIDE / 4];

static struct ddxvideo_picture picture(int number) {
    memset(luma, number, sizeof luma);
    return (struct ddxvideo_picture){.geometry = {.width = SIDE, .height = SIDE, .rate_num = 25, .rate_den = 1},
                                     .stamp = {.frame = number},
                                     .plane = {luma, chroma[0], chroma[1]},
                                     .stride = {SIDE, SIDE / 2, SIDE / 2},
                                     .rows = {SIDE, SIDE / 2, SIDE / 2}};
}

/* Returns the number of dropped frames. */
static uint64_t put(struct preroll *preroll, int number, uint64_t missed, int64_t published) {
    struct ddxvideo_picture view = picture(number);
    struct recording_frame frame = {.published = published, .sequence = (uint64_t)number, .missed = missed};

    return preroll_put(preroll, QUEUE, &view, &frame);
}

static void check_next(struct preroll *preroll, int number, uint64_t missed) {
    struct ddxvideo_picture view;
    struct recording_frame frame;

    CHECK(preroll_take(preroll, &view, &frame));
    CHECK_EQUAL(view.stamp.frame, number);
    CHECK_EQUAL(view.plane[0][SIDE * SIDE - 1], (unsigned char)number);
    CHECK_EQUAL(frame.missed, missed);
}

/* Six at most, a second at most; the number missed before a frame leaves with it. */
static void test_the_last_ones_wait(void) {
    struct preroll preroll = {.seconds = 1};

    CHECK_EQUAL(put(&preroll, 1, 3, 0), 0);
    for (int number = 2; number <= 6; number++)
        CHECK_EQUAL(put(&preroll, number, 0, 0), 0);
    CHECK_EQUAL(put(&preroll, 7, 0, 0), 1 + 3);
    CHECK_EQUAL(put(&preroll, 8, 0, 2 * NS), 6);
    check_next(&preroll, 8, 0);
    CHECK_EQUAL(preroll_clear(&preroll), 0);
}

/* A frame that is not kept may report a missing frame between two waiting ones. */
static void test_missed_between_them(void) {
    struct preroll preroll = {.seconds = 1};

    CHECK_EQUAL(preroll_missed(&preroll, 2), 2); /* frames before the first one were not wanted */
    CHECK_EQUAL(put(&preroll, 1, 0, 0), 0);
    CHECK_EQUAL(preroll_missed(&preroll, 3), 0);
    CHECK_EQUAL(preroll_missed(&preroll, 1), 0);
    CHECK_EQUAL(put(&preroll, 2, 1, 0), 0);
    CHECK_EQUAL(preroll_missed(&preroll, 7), 0);
    check_next(&preroll, 1, 0);
    check_next(&preroll, 2, 5);
    CHECK_EQUAL(preroll_missed_last(&preroll), 7);
    CHECK_EQUAL(preroll_clear(&preroll), 0);
}

static void test_nothing_is_forgotten(void) {
    struct preroll preroll = {.seconds = 1};

    CHECK_EQUAL(put(&preroll, 1, 2, 0), 0);
    CHECK_EQUAL(put(&preroll, 2, 4, 0), 0);
    CHECK_EQUAL(preroll_missed(&preroll, 8), 0);
    CHECK_EQUAL(preroll_clear(&preroll), 2 + 2 + 4 + 8);
    CHECK_EQUAL(preroll_clear(&preroll), 0);
}

int main(void) {
    test_the_last_ones_wait();
    test_missed_between_them();
    test_nothing_is_forgotten();
    return 0;
}
