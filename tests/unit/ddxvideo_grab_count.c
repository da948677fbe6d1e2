/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Gaps in a driver's numbers: lost and wanted frames, compared with a simple model that visits each frame. */
#include "check.h"
#include "frame_count.h"

static uint64_t lost_now;

/* A frame with this number; -1 if it is not wanted, else its position. */
static int64_t frame(struct count *count, uint32_t sequence) {
    bool wanted;
    uint64_t position;
    lost_now = count_frame(count, sequence, &wanted, &position);
    return wanted ? (int64_t)position : -1;
}

static void test_gaps(void) {
    struct count count = {.skip = 1};
    CHECK_EQUAL(frame(&count, 7), 0); /* the driver's first number is no loss */
    CHECK_EQUAL(lost_now, 0);
    CHECK_EQUAL(frame(&count, 8), 1);
    CHECK_EQUAL(frame(&count, 12), 5);
    CHECK_EQUAL(lost_now, 3);
    CHECK_EQUAL(count.lost, 3);
    CHECK_EQUAL(frame(&count, 12), 6); /* without numbers no loss is known */
    CHECK_EQUAL(lost_now, 0);
    CHECK_EQUAL(frame(&count, 3), 7); /* nor with numbers that go back */
    CHECK_EQUAL(lost_now, 0);
    count_restart(&count);
    CHECK_EQUAL(frame(&count, 100), 8);
    CHECK_EQUAL(lost_now, 0);
}

static void test_times(void) {
    const int64_t second = 1000000000, opened = 90 * second, now = 120 * second;

    CHECK_EQUAL(count_time(now - 5, opened, now), now - 5);
    CHECK_EQUAL(count_time(now + second, opened, now), now + second);
    CHECK_EQUAL(count_time(opened + 1, opened, now), opened + 1); /* the program was delayed since then */
    CHECK_EQUAL(count_time(opened - 3 * second, opened, now), now);
    CHECK_EQUAL(count_time(now + 3 * second, opened, now), now);
    CHECK_EQUAL(count_time(0, opened, now), now);
    CHECK_EQUAL(count_time(0, second, second + 1), second + 1);
}

/* A frame every 100 ms; of fifty, four are taken late and together, and five are lost. */
static void test_period(void) {
    const int64_t ms = 1000000;
    struct count count = {.skip = 1};
    int64_t period = 0, late = 0;

    CHECK_EQUAL(count_period(&count, 7, 700 * ms, 0), 0);
    CHECK_EQUAL(count_period(&count, 8, 800 * ms, 0), 100 * ms);
    for (int i = 9; i < 200; i++) {
        int64_t time = i * 100 * ms;

        if (i % 50 > 44)
            continue;
        late = i % 50 == 41 ? time + 300 * ms : late + 1;
        period = count_period(&count, (uint64_t)i, i % 50 > 40 ? late : time, period);
        CHECK(period > 75 * ms && period < 125 * ms);
    }
    count_restart(&count);
    CHECK_EQUAL(count_period(&count, 200, 50000 * ms, 0), 0);
}

static void test_wrap(void) {
    struct count count = {.skip = 1};
    CHECK_EQUAL(frame(&count, UINT32_MAX - 1), 0);
    CHECK_EQUAL(frame(&count, 1), 3);
    CHECK_EQUAL(lost_now, 2);
    CHECK_EQUAL(count.lost, 2);
}

static void test_skip(void) {
    struct count count = {.skip = 5};
    CHECK_EQUAL(frame(&count, 0), 0);
    for (uint32_t i = 1; i < 5; i++)
        CHECK_EQUAL(frame(&count, i), -1);
    CHECK_EQUAL(frame(&count, 6), -1); /* number 5 is lost, the only wanted one of these */
    CHECK_EQUAL(lost_now, 1);
    CHECK_EQUAL(frame(&count, 10), 10); /* the rhythm stays */
    CHECK_EQUAL(lost_now, 0);
    CHECK_EQUAL(count_pass(&count, 10), 2);
    CHECK_EQUAL(count.position, 21);
    CHECK_EQUAL(count.lost, 4);
}

/* Random gaps: every number that was wanted is either delivered or counted as lost, and none twice. */
static void test_random(uint64_t skip) {
    struct count count = {.skip = skip};
    uint32_t start = UINT32_MAX - 500, now = 0;
    uint64_t lost = 0, delivered = 0, expected = 0;
    srand(1);
    for (int i = 0; i < 2000; i++) {
        int64_t position = frame(&count, start + now);
        CHECK(position < 0 || (uint64_t)position == now);
        CHECK_EQUAL(position >= 0, now % skip == 0);
        lost += lost_now;
        delivered += position >= 0;
        expected = now / skip + 1;
        CHECK_EQUAL(lost + delivered, expected);
        now += rand() % 4 ? 1 : 1 + (uint32_t)rand() % 9;
    }
}

int main(void) {
    test_gaps();
    test_times();
    test_period();
    test_wrap();
    test_skip();
    for (uint64_t skip = 1; skip < 8; skip++)
        test_random(skip);
    return 0;
}
