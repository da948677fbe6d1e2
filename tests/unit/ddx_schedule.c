/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The schedule is exact after hours and days, for every frame rate, and for clips that are repeated. */
#include "check.h"
#include "schedule.h"

#define NS INT64_C(1000000000)

/* The exact result, in 128 bits where the compiler has them, else by long division. */
static int64_t exact(uint64_t index, uint32_t num, uint32_t den) {
#ifdef __SIZEOF_INT128__
    return (int64_t)((unsigned __int128)index * den * (uint64_t)NS / num);
#else
    return schedule_offset(index, num, den);
#endif
}

static void test_no_drift(void) {
    static const uint32_t rates[][2] = {
        {25, 1}, {30000, 1001}, {24000, 1001},    {60000, 1001},          {5, 1},
        {1, 3},  {15, 2},       {1000000, 33333}, {2147483647, 71582789}, {4294967295, 4294967294}};
    for (size_t i = 0; i < sizeof(rates) / sizeof(*rates); i++) {
        uint32_t num = rates[i][0], den = rates[i][1];
        uint64_t hour = (uint64_t)num * 3600 / den;
        int64_t before = -1;
        for (uint64_t index = 0; index <= hour; index++) {
            int64_t offset = schedule_offset(index, num, den);
            CHECK_EQUAL(offset, exact(index, num, den));
            CHECK(offset > before);
            before = offset;
        }
        for (uint64_t index = hour * 24; index < hour * 24 * 365 * 20; index = index * 3 + 1)
            CHECK_EQUAL(schedule_offset(index, num, den), exact(index, num, den));
    }
    /* An hour of NTSC: 107892 frames are 3599.9964 s, and 30000 frames are 1001 s, to the nanosecond. */
    CHECK_EQUAL(schedule_offset(107892, 30000, 1001), 107892 * INT64_C(1001) * NS / 30000);
    CHECK_EQUAL(schedule_offset(30000 * 4, 30000, 1001), 4004 * NS);
    CHECK_EQUAL(schedule_offset(UINT64_MAX, 1, UINT32_MAX), INT64_MAX);
    CHECK_EQUAL(schedule_offset(UINT64_MAX, 1, 1), INT64_MAX);
}

static void test_speed(void) {
    static const struct {
        const char *text;
        bool good;
        uint32_t num, den;
    } table[] = {
        {"1", true, 1, 1},
        {"2", true, 2, 1},
        {"0.5", true, 5, 10},
        {"29.97", true, 2997, 100},
        {"0", true, 0, 1},
        {"0.0", true, 0, 10},
        {".25", true, 25, 100},
        {"1000", true, 1000, 1},
        {"0.000001", true, 1, 1000000},
        {"1000.1", false, 0, 0},
        {"", false, 0, 0},
        {".", false, 0, 0},
        {"-1", false, 0, 0},
        {"1e3", false, 0, 0},
        {"1.2.3", false, 0, 0},
        {"0.0000001", false, 0, 0},
        {"99999999999999999999", false, 0, 0},
        {"nan", false, 0, 0},
        {" 1", false, 0, 0},
    };
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++) {
        struct schedule_speed speed = {0, 0};
        CHECK(schedule_parse_speed(table[i].text, &speed) == table[i].good);
        if (table[i].good) {
            CHECK_EQUAL(speed.num, table[i].num);
            CHECK_EQUAL(speed.den, table[i].den);
        }
    }
    CHECK_EQUAL(schedule_scale(10 * NS, 10, 5), 20 * NS);
    CHECK_EQUAL(schedule_scale(1001, 1, 2), 500);
    CHECK_EQUAL(schedule_scale(NS * NS, 100, 2997), INT64_C(33366700033366700));
    CHECK_EQUAL(schedule_scale(NS * NS, UINT32_MAX, 1), INT64_MAX);
}

static void test_loop_by_rate(void) {
    struct schedule schedule;
    schedule_init(&schedule, 30000, 1001);
    for (uint64_t index = 0; index < 108000; index++) {
        CHECK_EQUAL(schedule_next(&schedule, -1), schedule_offset(index, 30000, 1001));
        if (index % 7 == 6)
            schedule_loop(&schedule);
    }
}

static void test_loop_recorded(void) {
    struct schedule schedule;
    schedule_init(&schedule, 25, 1);
    /* Recorded times are kept as they are; the next pass begins a frame period after the last. */
    CHECK_EQUAL(schedule_next(&schedule, 0), 0);
    CHECK_EQUAL(schedule_next(&schedule, 41 * NS / 1000), 41 * NS / 1000);
    CHECK_EQUAL(schedule_next(&schedule, 41 * NS / 1000), 41 * NS / 1000);
    CHECK_EQUAL(schedule_next(&schedule, NS), NS);
    CHECK_EQUAL(schedule_next(&schedule, -1), NS + NS / 25);
    schedule_loop(&schedule);
    CHECK_EQUAL(schedule_next(&schedule, 0), NS + 2 * NS / 25);
    CHECK_EQUAL(schedule_next(&schedule, NS), 2 * NS + 2 * NS / 25);
    schedule_loop(&schedule);
    CHECK_EQUAL(schedule_next(&schedule, 0), 2 * NS + 3 * NS / 25);
    /* A file cut out of the middle of another begins at once. */
    schedule_init(&schedule, 25, 1);
    CHECK_EQUAL(schedule_next(&schedule, 500 * NS), 0);
    CHECK_EQUAL(schedule_next(&schedule, 501 * NS), NS);
    CHECK_EQUAL(schedule_next(&schedule, 499 * NS), 0);
    CHECK_EQUAL(schedule_next(&schedule, NS * NS), NS * NS - 500 * NS);
}

/* 25 frames a second; the player stops for a second before the hundredth. */
static void test_catching_up(void) {
    enum { FRAMES = 300, LATE = 100 };
    const int64_t period = NS / 25, stall = NS;
    int64_t at[FRAMES], now = -NS;
    struct schedule_pace pace = {.begun = false};
    for (int i = 0; i < FRAMES; i++) {
        int64_t due = i * period, then = schedule_catch_up(&pace, due);
        now += NS / 10000; /* other work of the player */
        if (i == LATE)
            now += stall;
        if (then > now)
            now = then;
        at[i] = now;
        pace = (struct schedule_pace){true, due, now};
        CHECK(now >= due);
    }
    for (int i = 2; i < FRAMES; i++)
        CHECK(at[i] - at[i - 2] >= period);
    CHECK(at[LATE] > LATE * period + stall - period);
    for (int i = 0; i < LATE; i++)
        CHECK_EQUAL(at[i], i * period);
    /* The player catches up by half a period a frame. */
    for (int i = LATE + 2 * 25; i < FRAMES; i++)
        CHECK_EQUAL(at[i], i * period);
}

/* The clip's times count: frames recorded together are played together, and after a gap frames are on time. */
static void test_catching_up_unevenly(void) {
    struct schedule_pace pace = {.due = 5 * NS, .published = 9 * NS};
    CHECK_EQUAL(schedule_catch_up(&pace, 6 * NS), 6 * NS);
    pace.begun = true;
    CHECK_EQUAL(schedule_catch_up(&pace, 5 * NS), 5 * NS);
    CHECK_EQUAL(schedule_catch_up(&pace, 4 * NS), 4 * NS);
    CHECK_EQUAL(schedule_catch_up(&pace, 5 * NS + 2), 9 * NS + 1);
    CHECK_EQUAL(schedule_catch_up(&pace, 20 * NS), 20 * NS);
    CHECK_EQUAL(schedule_catch_up(&pace, INT64_MAX), INT64_MAX);
}

int main(void) {
    test_no_drift();
    test_speed();
    test_loop_by_rate();
    test_loop_recorded();
    test_catching_up();
    test_catching_up_unevenly();
    return 0;
}
