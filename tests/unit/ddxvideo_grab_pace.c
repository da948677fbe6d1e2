/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Numbers and times of frames of a camera that sends no numbers, and times of a clock that is set. */
#include "check.h"
#include "pace.h"

#define MS INT64_C(1000000)
#define PERIOD (40 * MS)
#define BEGIN (1000 * MS)

/* Number of frames missing before a frame at this many periods (in hundredths) after the first one. */
static unsigned step(struct pace *pace, int64_t hundredths, bool more) {
    uint32_t before = pace->number;
    return pace_number(pace, BEGIN + PERIOD * hundredths / 100, more) - before - 1;
}

static struct pace begin(int64_t period) {
    struct pace pace = {.number = 7};
    pace_restart(&pace, period);
    CHECK_EQUAL(pace_number(&pace, BEGIN, false), 8);
    return pace;
}

static void test_gaps_are_counted(void) {
    struct pace pace = begin(PERIOD);
    CHECK_EQUAL(step(&pace, 100, false), 0);
    CHECK_EQUAL(step(&pace, 300, false), 1);
    CHECK_EQUAL(step(&pace, 330, false), 0); /* two frames never have one number */
    CHECK_EQUAL(step(&pace, 400, false), 0);
    CHECK_EQUAL(step(&pace, 10000, false), 94); /* one of the 95 was counted at 330 */
}

/* Delayed frames come together; the time of the last one gives their number. */
static void test_frames_that_waited_are_not_lost(void) {
    struct pace pace = begin(PERIOD);
    for (int i = 1; i < 4; i++)
        CHECK_EQUAL(step(&pace, 400, true), 0);
    CHECK_EQUAL(step(&pace, 400, false), 0);
    CHECK_EQUAL(step(&pace, 700, true), 0);
    CHECK_EQUAL(step(&pace, 700, false), 1);
}

/* By jitter of a third of a period, and a camera whose clock is 0.2 % fast or slow, nothing is lost. */
static void test_jitter_and_drift(int64_t permille) {
    struct pace pace = begin(PERIOD);
    for (int i = 1; i < 20000; i++) {
        int64_t time = BEGIN + i * (PERIOD * permille / 1000) + rand() % (PERIOD / 3);
        bool lost = i % 1000 == 0;
        if (lost)
            continue;
        uint32_t before = pace.number;
        CHECK_EQUAL(pace_number(&pace, time, false) - before - 1, i % 1000 == 1 && i > 1);
    }
}

/* A delay that counts as a loss is offset by the next frame: the sum does not grow. */
static void test_delays_alone_do_not_add_up(void) {
    struct pace pace = begin(PERIOD);
    unsigned lost = 0;
    for (int i = 1; i < 1000; i++)
        lost += step(&pace, 100 * i + (i % 10 ? 0 : 80), false);
    CHECK(lost <= 1);
}

#define CYCLES 64000

/* On FireWire neither a delay below a second nor a wrap of the bus time has an effect. */
static void test_the_bus_time_counts_exactly(void) {
    struct pace pace = {.number = 7};
    pace_restart(&pace, PERIOD);
    for (unsigned i = 0; i < 2000; i++) {
        if (i % 100 == 42 || (i > 500 && i < 1100)) /* lost; the bus time wraps three times in the second gap */
            continue;
        int64_t late = i % 7 ? 0 : (int64_t)(i * 77 % 900) * MS;
        CHECK_EQUAL(pace_bus_number(&pace, (60000 + i * 320) % CYCLES + 1, BEGIN + PERIOD * i + late), 8 + i);
    }
}

/* The bus time jumps when the bus gets another cycle master. */
static void test_another_cycle_master_is_no_loss(void) {
    struct pace pace = {.number = 7};
    pace_restart(&pace, PERIOD);
    for (unsigned i = 0; i < 100; i++)
        CHECK_EQUAL(pace_bus_number(&pace, (i * 320 + (i < 50 ? 0 : 30000)) % CYCLES + 1, BEGIN + PERIOD * i), 8 + i);
}

static void test_a_period_is_learned(void) {
    struct pace pace = begin(0);
    for (int i = 1; i <= PACE_ALIKE + 1; i++)
        CHECK_EQUAL(step(&pace, 100 * i, false), 0);
    CHECK_EQUAL(pace.period, PERIOD);
    CHECK_EQUAL(step(&pace, 100 * (PACE_ALIKE + 4), false), 2);
}

/* From frames with jitter, exactly enough that later frames do not count as lost. */
static void test_a_period_is_learned_from_several_steps(void) {
    struct pace pace = begin(0);
    for (int i = 1; i < 1000; i++)
        CHECK_EQUAL(step(&pace, 100 * i + (i % 2 ? 3 : -3), false), 0);
    CHECK(pace.period > PERIOD * 99 / 100 && pace.period < PERIOD * 101 / 100);
}

static void test_triggered_frames_have_no_gaps(void) {
    struct pace pace = begin(PACE_NONE);
    for (int i = 1; i < 30; i++)
        CHECK_EQUAL(step(&pace, 100 * i, false), 0);
    CHECK_EQUAL(step(&pace, 90000, false), 0);
}

static void test_numbers_wrap(void) {
    struct pace pace = {.number = UINT32_MAX - 1};
    pace_restart(&pace, PERIOD);
    CHECK_EQUAL(pace_number(&pace, BEGIN, false), UINT32_MAX);
    CHECK_EQUAL(pace_number(&pace, BEGIN + PERIOD, false), 0);
    CHECK_EQUAL(pace_number(&pace, BEGIN + 4 * PERIOD, false), 3);
}

/* A frame of 5 ms ago; then the clock is set, before or after it was captured. */
static void test_a_set_clock_does_not_show(int64_t set) {
    const int64_t offset = INT64_C(1700000000) * 1000 * MS, now = 5000 * MS;
    for (int captured_before = 0; captured_before < 2; captured_before++) {
        struct wall wall = {0};
        CHECK_EQUAL(wall_time(&wall, (uint64_t)(offset + now) / 1000, now, offset), now);
        int64_t time = now + 40 * MS, seen = time + 5 * MS;
        uint64_t us = (uint64_t)(time + offset + (captured_before ? 0 : set)) / 1000;
        CHECK_EQUAL(wall_time(&wall, us, seen, offset + set), time);
    }
}

static void test_useless_times(void) {
    struct wall wall = {0};
    CHECK_EQUAL(wall_time(&wall, 0, 5000 * MS, 0), 0);
    wall_time(&wall, UINT64_MAX, 5000 * MS, INT64_C(1) << 60); /* no overflow */
}

int main(void) {
    test_gaps_are_counted();
    test_frames_that_waited_are_not_lost();
    test_jitter_and_drift(998);
    test_jitter_and_drift(1002);
    test_delays_alone_do_not_add_up();
    test_the_bus_time_counts_exactly();
    test_another_cycle_master_is_no_loss();
    test_a_period_is_learned();
    test_a_period_is_learned_from_several_steps();
    test_triggered_frames_have_no_gaps();
    test_numbers_wrap();
    test_a_set_clock_does_not_show(3600 * 1000 * MS);
    test_a_set_clock_does_not_show(-3600 * 1000 * MS);
    test_a_set_clock_does_not_show(30 * MS);
    test_a_set_clock_does_not_show(-30 * MS);
    test_useless_times();
    return 0;
}
