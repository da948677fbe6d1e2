/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The rollover counter in the header extension: added, read and removed in any header, without a read beyond it. */
#include "secure.h"

#include "check.h"

/* A copy of exactly this size, so that a sanitizer sees a read beyond it. */
static void check_none(const uint8_t *data, size_t size) {
    uint8_t *copy = malloc(size + 1);
    uint32_t counter;

    CHECK(copy);
    memcpy(copy + 1, data, size);
    CHECK(!rollover_get(copy + 1, size, &counter));
    CHECK_EQUAL(rollover_take(copy + 1, size), size);
    CHECK(!memcmp(copy + 1, data, size));
    free(copy);
}

static void test_bytes(void) {
    const uint8_t plain[] = {0x80, 96, 0, 4, 0, 0, 0, 1, 0, 0, 0, 2, 'a', 'b'};
    const uint8_t with[] = {0x90, 96, 0, 4, 0, 0, 0, 1, 0, 0, 0, 2, 0xbe, 0xde, 0, 1, 0x42, 0x12, 0x34, 0x56, 'a', 'b'};
    uint8_t data[sizeof plain + ROLLOVER_GROWTH];
    uint32_t counter;

    check_none(plain, sizeof plain);
    memcpy(data, plain, sizeof plain);
    CHECK_EQUAL(rollover_put(data, sizeof plain, 0x78123456), sizeof with);
    CHECK(!memcmp(data, with, sizeof with));
    CHECK(rollover_get(data, sizeof with, &counter));
    CHECK_EQUAL(counter, 0x123456);
    CHECK_EQUAL(rollover_take(data, sizeof with), sizeof plain);
    CHECK(!memcmp(data, plain, sizeof plain));
    for (size_t size = 0; size < 20; size++) /* cut short */
        check_none(with, size);
}

/* Beside other elements and contributing sources, down to a packet that is only a header. */
static void test_extended(void) {
    uint8_t data[200] = {0}, before[200];

    for (unsigned sources = 0; sources < 16; sources++)
        for (unsigned words = 1; words < 20; words++)
            for (unsigned payload = 0; payload < 6; payload++) {
                size_t at = 12 + 4 * sources, size = at + 4 + 4 * words + payload;
                memset(data, 0x42, size);
                memcpy(data + at, (uint8_t[]){0xbe, 0xde, 0, (uint8_t)words, 0x22}, 5);
                data[0] = (uint8_t)(0x90 | sources);
                memcpy(before, data, size);
                uint32_t counter;
                CHECK_EQUAL(rollover_put(data, size, sources), size + 4);
                CHECK(rollover_get(data, size + 4, &counter));
                CHECK_EQUAL(counter, sources);
                CHECK_EQUAL(rollover_take(data, size + 4), size);
                CHECK(!memcmp(data, before, size));
            }
}

/* An extension of another form, an empty one, one that is longer than the packet: they do not change. */
static void test_others(void) {
    static const uint8_t cases[][20] = {
        {0x90, 96, [12] = 0xbe, 0xde, 0, 0, 0x42, 1, 2, 3}, {0x90, 96, [12] = 0x10, 0x00, 0, 1, 0x42, 1, 2, 3},
        {0x90, 96, [12] = 0xbe, 0xde, 0, 2, 0x42, 1, 2, 3}, {0x90, 96, [12] = 0xbe, 0xde, 0xff, 0xff, 0x42, 1, 2, 3},
        {0x50, 96, [12] = 0xbe, 0xde, 0, 1, 0x42, 1, 2, 3}, {0x93, 96, [12] = 0xbe, 0xde, 0, 1, 0x42, 1, 2, 3}};

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        uint8_t data[28];
        check_none(cases[i], 20);
        memcpy(data, cases[i], 20);
        CHECK_EQUAL(rollover_put(data, 20, 5), 20);
        CHECK(!memcmp(data, cases[i], 20));
    }
}

int main(void) {
    test_bytes();
    test_extended();
    test_others();
    return 0;
}
