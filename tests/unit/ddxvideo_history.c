/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The viewer's history: which frames are kept, bounds, losses, disparities. */
#include "history.h"

#include <stdlib.h>
#include <string.h>

#include "check.h"

static struct shot *picture(struct history *history, int number, int width) {
    static unsigned char luma[64 * 64], chroma[32 * 32];
    const struct ddxvideo_picture picture = {.geometry = {.width = width, .height = 64, .fields = 1},
                                             .stamp = {.frame = number, .time = number * 1000},
                                             .plane = {luma, chroma, chroma},
                                             .stride = {64, 32, 32},
                                             .rows = {64, 32, 32}};

    for (int i = 0; i < 64 * 64; i++)
        luma[i] = (unsigned char)(number + i % 64);
    return history_copy(history, &picture);
}

static void check_kept(struct history *history, int64_t first, int64_t last) {
    int64_t oldest, newest;

    history_range(history, &oldest, &newest);
    CHECK_EQUAL(oldest, first);
    CHECK_EQUAL(newest, last);
    CHECK(!history_take(history, first - 1) && !history_take(history, last + 1));
    CHECK_EQUAL(history_time(history, last + 1), 0);
    for (int64_t at = first; at <= last; at++) {
        struct shot *shot = history_take(history, at);

        CHECK(shot && shot->picture.stamp.frame == at && shot->picture.plane[0][0] == (unsigned char)at);
        CHECK_EQUAL(history_time(history, at), at * 1000);
        shot_drop(shot);
    }
}

static void test_frames(void) {
    struct history history;

    CHECK(history_open(&history, 5, UINT64_MAX));
    check_kept(&history, 0, -1);
    for (int i = 0; i < 12; i++) {
        history_add(&history, picture(&history, i, 64));
        check_kept(&history, i < 5 ? 0 : i - 4, i);
    }
    history_close(&history);
}

/* The history is also limited by bytes; a frame above the limit is kept alone. */
static void test_bytes(void) {
    struct history history;

    CHECK(history_open(&history, 100, 3 * (64 * 64 / 2 * 3 + sizeof(struct shot))));
    for (int i = 0; i < 12; i++)
        history_add(&history, picture(&history, i, 64));
    check_kept(&history, 9, 11);
    history_close(&history);
    CHECK(history_open(&history, 100, 10));
    for (int i = 0; i < 3; i++)
        history_add(&history, picture(&history, i, 64));
    check_kept(&history, 2, 2);
    history_close(&history);
}

/* There are never more pictures than fit, not even while one is copied; but one is always kept. */
static void test_room(void) {
    struct history history;

    CHECK(history_open(&history, 100, 3 * (64 * 64 / 2 * 3 + sizeof(struct shot))));
    for (int i = 0; i < 9; i++) {
        struct shot *shot = picture(&history, i, 64);

        if (i)
            check_kept(&history, i < 2 ? 0 : i - 2, i - 1);
        history_add(&history, shot);
    }
    history_close(&history);
    CHECK(history_open(&history, 1, 10));
    for (int i = 0; i < 3; i++) {
        struct shot *shot = picture(&history, i, 64);

        check_kept(&history, i ? i - 1 : 0, i - 1);
        history_add(&history, shot);
    }
    history_close(&history);
}

/* A held picture does not change when the history has dropped it, and keeps its stride. */
static void test_held(void) {
    struct history history;

    CHECK(history_open(&history, 2, UINT64_MAX));
    history_add(&history, picture(&history, 0, 32));
    struct shot *held = history_take(&history, 0);
    for (int i = 1; i < 9; i++)
        history_add(&history, picture(&history, i, 32));
    CHECK_EQUAL(held->picture.stride[0], 32);
    for (int i = 0; i < 32 * 64; i++)
        CHECK_EQUAL(held->picture.plane[0][i], (unsigned char)(i % 32));
    shot_drop(held);
    history_close(&history);
}

static void test_losses(void) {
    struct history history;

    CHECK(history_open(&history, 2, UINT64_MAX));
    for (int i = 0; i < 6; i++) {
        struct shot *shot = picture(&history, i, 64);

        shot->missing = (uint64_t)i;
        history_add(&history, shot);
    }
    history_lose(&history, 100);
    CHECK_EQUAL(history_lost(&history), 115u); /* also those before frames that were dropped */
    history_pend(&history, 7);
    history_pend(&history, 8);
    CHECK_EQUAL(history_lost(&history), 123u);
    struct shot *next = picture(&history, 6, 64);
    next->missing = 8;
    history_add(&history, next);
    CHECK_EQUAL(history_lost(&history), 123u);
    history_close(&history);
}

/* Also of frames that have been dropped since. */
static void test_rate(unsigned kept) {
    struct history history;

    CHECK(history_open(&history, kept, UINT64_MAX));
    CHECK(history_rate(&history, 0) == 0);
    for (int i = 0; i < 50; i++) {
        struct shot *shot = picture(&history, i, 64);

        shot->picture.stamp.time = shot->arrival = i * INT64_C(40000000);
        history_add(&history, shot);
    }
    double rate = history_rate(&history, 49 * INT64_C(40000000));
    CHECK(rate > 24.99 && rate < 25.01);
    CHECK(history_rate(&history, 60 * INT64_C(1000000000)) == 0);
    history_close(&history);
}

static void test_depth(void) {
    struct history history;

    CHECK(history_open(&history, 2, UINT64_MAX));
    for (int i = 0; i < 3; i++)
        history_add(&history, picture(&history, i, 64));
    for (int i = 0; i < 4; i++) { /* of frame 0, which was dropped; of 1 and 2; and of a frame that has not come */
        struct shot_depth *depth = calloc(1, sizeof *depth + 2);

        *depth = (struct shot_depth){.width = 1, .height = 1};
        depth->disparity[0] = (uint16_t)i;
        history_depth(&history, i, depth);
    }
    for (int i = 1; i < 3; i++) {
        struct shot *shot = history_take(&history, i);

        CHECK(shot->depth && shot->depth->disparity[0] == i);
        shot_drop(shot);
    }
    history_close(&history);
}

int main(void) {
    test_frames();
    test_bytes();
    test_room();
    test_held();
    test_losses();
    test_rate(100);
    test_rate(1);
    test_depth();
    return 0;
}
