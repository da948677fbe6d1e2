/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The frames that are recorded with a rate or a skip: evenly, exactly, and the same ones for each caller. */
#include <errno.h>
#include <stdbool.h>

#include "check.h"
#include "decimate.h"

static bool wants(const struct decimate *decimate, uint64_t sequence) {
    return decimate_wants(decimate, sequence, 1);
}

static struct ddxvideo_geometry camera(int num, int den) {
    return (struct ddxvideo_geometry){.width = 352, .height = 288, .rate_num = num, .rate_den = den};
}

static void test_one_of(void) {
    for (long skip = 1; skip <= 7; skip++) {
        struct decimate decimate = {.skip = skip};
        struct ddxvideo_geometry geometry = camera(30000, 1001);
        CHECK_EQUAL(decimate_look(&decimate, &geometry), 0);
        CHECK_EQUAL((int64_t)geometry.rate_num * 1001 * skip, (int64_t)geometry.rate_den * 30000);
        for (uint64_t sequence = 1; sequence < 1000; sequence++)
            CHECK_EQUAL(wants(&decimate, sequence), (sequence - 1) % (uint64_t)skip == 0);
    }
}

static void test_rate(void) {
    static const struct {
        uint32_t num, den;
        int their_num, their_den;
        uint64_t of_3000; /* of 3000 frames */
    } table[] = {
        {10, 1, 25, 1, 1200},           {125, 10, 25, 1, 1500},   {25, 1, 25, 1, 3000}, {26, 1, 25, 1, 3000},
        {1000, 1, 5, 1, 3000},          {5, 1, 30, 1, 500},       {24, 1, 25, 1, 2880}, {1, 1000000, 30, 1, 1},
        {2997, 100, 30000, 1001, 3000}, {1, 1, 30000, 1001, 101},
    };
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++) {
        struct decimate decimate = {.rate_num = table[i].num, .rate_den = table[i].den};
        struct ddxvideo_geometry geometry = camera(table[i].their_num, table[i].their_den);
        CHECK_EQUAL(decimate_look(&decimate, &geometry), 0);
        CHECK_EQUAL(decimate_up_to(&decimate, 3000), table[i].of_3000);
        double theirs = (double)table[i].their_num / table[i].their_den, wanted = (double)table[i].num / table[i].den;
        double is = (double)geometry.rate_num / geometry.rate_den, least = wanted < theirs ? wanted : theirs;
        CHECK(is > least * 0.9999 && is < least * 1.0001);
        /* Even: distances differ by one at most. */
        uint64_t last = 1, shortest = UINT64_MAX, longest = 0;
        CHECK(wants(&decimate, 1));
        for (uint64_t sequence = 2; sequence <= 3000; sequence++)
            if (wants(&decimate, sequence)) {
                uint64_t distance = sequence - last;
                shortest = distance < shortest ? distance : shortest;
                longest = distance > longest ? distance : longest;
                last = sequence;
            }
        CHECK(longest == 0 || longest - shortest <= 1);
    }
}

/* Very large numbers, and rates that no camera has. */
static void test_large(void) {
    struct decimate decimate = {.rate_num = 999999999, .rate_den = 1000000};
    struct ddxvideo_geometry geometry = camera(INT32_MAX, 2);
    CHECK_EQUAL(decimate_look(&decimate, &geometry), 0);
    uint64_t before = decimate_up_to(&decimate, UINT64_MAX - 2000000);
    CHECK(before < UINT64_MAX / 1000000);
    CHECK(decimate_up_to(&decimate, UINT64_MAX) - before <= 2);
    CHECK(geometry.rate_num > 0 && geometry.rate_den > 0);
}

static void test_unknown_rate(void) {
    struct decimate decimate = {.rate_num = 5, .rate_den = 1};
    struct ddxvideo_geometry geometry = camera(0, 0);
    CHECK_EQUAL(decimate_look(&decimate, &geometry), -ENODATA);
    CHECK_EQUAL(decimate_up_to(&decimate, 77), 77);
    struct decimate skip = {.skip = 4};
    CHECK_EQUAL(decimate_look(&skip, &geometry), 0);
    CHECK_EQUAL(decimate_up_to(&skip, 77), 20);
    CHECK_EQUAL(geometry.rate_num, 0);
    geometry = camera(25, 1); /* the rate is known now */
    CHECK_EQUAL(decimate_look(&decimate, &geometry), 0);
    CHECK_EQUAL(decimate_up_to(&decimate, 50), 10);
}

int main(void) {
    test_one_of();
    test_rate();
    test_large();
    test_unknown_rate();
    return 0;
}
