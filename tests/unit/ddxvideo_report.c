/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Reports: each byte in its place, impossible ones refused, other RTCP packets skipped. */
#include "report.h"

#include <errno.h>

#include "check.h"

#define MS INT64_C(1000000)

static const struct report whole = {.reporter = 0x01020304,
                                    .media = 0x05060708,
                                    .has_state = true,
                                    .highest = 2,
                                    .base = 0xfffe,
                                    .missing = 3,
                                    .loss = 77,
                                    .has_repair = true,
                                    .highest_repair = 0x1234,
                                    .age = 12 * MS,
                                    .refresh = true};

/* In memory of exactly this size, so that a sanitizer sees a read beyond it. */
static int parse(const uint8_t *data, size_t size, struct report *report) {
    uint8_t *copy = malloc(size + !size);
    memcpy(copy, data, size);
    int error = report_parse(copy, size, report);
    free(copy);
    return error;
}

static void check_bytes(void) {
    static const uint8_t expected[] = {0x8f, 206, 0,    7,    1,    2, 3, 4,  5, 6,    7,    8, 'D', 'D', 'X',
                                       '1',  0,   2,    0xff, 0xfe, 0, 3, 77, 1, 0x12, 0x34, 0, 48,  0,   0,
                                       0,    0,   0x81, 206,  0,    2, 1, 2,  3, 4,    5,    6, 7,   8};
    uint8_t data[REPORT_MAX];

    CHECK_EQUAL(report_write(data, &whole), sizeof expected);
    CHECK(!memcmp(data, expected, sizeof expected));
}

static void check_same(const struct report *sent) {
    uint8_t data[REPORT_MAX];
    struct report got;
    size_t size = report_write(data, sent);

    CHECK_EQUAL(parse(data, size, &got), 0);
    CHECK_EQUAL(got.reporter, sent->reporter);
    CHECK_EQUAL(got.media, sent->media);
    CHECK_EQUAL(got.has_state, sent->has_state);
    CHECK_EQUAL(got.refresh, sent->refresh);
    CHECK_EQUAL(got.has_repair, sent->has_repair && sent->has_state);
    CHECK_EQUAL(got.missing, sent->has_state ? sent->missing : 0);
    CHECK_EQUAL(got.age, sent->has_state ? sent->age : 0);
    for (size_t cut = 0; cut < size; cut++)
        CHECK_EQUAL(parse(data, cut, &got), cut == REPORT_SIZE && sent->has_state ? 0 : -EBADMSG);
}

static void check_ages(void) {
    static const int64_t ages[][2] = {{-MS, 0}, {249999, 0}, {250000, 250000}, {INT64_MAX, REPORT_OLDEST_NS}};
    uint8_t data[REPORT_MAX];

    for (size_t index = 0; index < sizeof ages / sizeof *ages; index++) {
        struct report report = whole, got;
        report.age = ages[index][0];
        CHECK_EQUAL(parse(data, report_write(data, &report), &got), 0);
        CHECK_EQUAL(got.age, ages[index][1]);
    }
}

static void check_possible(void) {
    static const struct {
        uint16_t highest, base, missing;
        int error;
    } cases[] = {
        {9, 10, 0, 0},         {9, 10, 1, -EBADMSG},     {9, 11, 0, -EBADMSG},     {9, 9, 1, 0},
        {9, 9, 2, -EBADMSG},   {0, 0xffff, 2, 0},        {0, 0xffff, 3, -EBADMSG}, {255, 0, 256, 0},
        {256, 0, 1, -EBADMSG}, {0x8000, 0, 1, -EBADMSG}, {0xffff, 0, 0, 0},        {0xff, 0xffff, 0, -EBADMSG},
    };
    uint8_t data[REPORT_MAX];

    for (size_t index = 0; index < sizeof cases / sizeof *cases; index++) {
        struct report report = whole, got;
        report.highest = cases[index].highest;
        report.base = cases[index].base;
        report.missing = cases[index].missing;
        CHECK_EQUAL(parse(data, report_write(data, &report), &got), cases[index].error);
    }
}

/* Parse a report after other packets in one datagram. */
static int parse_after(const uint8_t *other, size_t size, const struct report *report) {
    uint8_t data[200 + REPORT_MAX];
    struct report got;

    memcpy(data, other, size);
    return parse(data, size + report_write(data + size, report), &got);
}

static void check_others(void) {
    static const uint8_t receiver[] = {0x80, 201, 0, 1, 1, 2, 3, 4}, bye[] = {0x80, 203, 0, 0};
    static const uint8_t application[] = {0x8f, 206, 0, 3, 1, 2, 3, 4, 5, 6, 7, 8, 'R', 'E', 'M', 'B'};
    static const uint8_t rtp[] = {0x80, 96, 0, 1, 1, 2, 3, 4}, shortest[] = {0x81, 206, 0, 1, 1, 2, 3, 4};
    struct report got, elsewhere = whole, without = whole;
    uint8_t two[2 * REPORT_MAX];

    CHECK_EQUAL(parse_after(receiver, sizeof receiver, &whole), 0);
    CHECK_EQUAL(parse_after(application, sizeof application, &whole), 0);
    CHECK_EQUAL(parse_after(rtp, sizeof rtp, &whole), -EBADMSG);
    CHECK_EQUAL(parse_after(shortest, sizeof shortest, &whole), -EBADMSG);
    CHECK_EQUAL(parse(receiver, sizeof receiver, &got), -ENOMSG);
    CHECK_EQUAL(parse(application, sizeof application, &got), -ENOMSG);
    CHECK_EQUAL(parse(bye, sizeof bye, &got), -ENOMSG);
    CHECK_EQUAL(parse_after(bye, sizeof bye - 1, &whole), -EBADMSG);
    size_t size = report_write(two, &whole);
    CHECK_EQUAL(parse(two, size + report_write(two + size, &whole), &got), -EBADMSG); /* two reports */
    elsewhere.reporter++;
    elsewhere.has_state = without.refresh = false;
    size = report_write(two, &without);
    CHECK_EQUAL(parse(two, size + report_write(two + size, &elsewhere), &got), -EBADMSG); /* two reporters */
}

/* Padding belongs to the last packet, counts itself, and is a multiple of 4. */
static void check_padding(void) {
    static const uint8_t bye[] = {0x80, 203, 0, 0};
    struct report report = whole, got;
    uint8_t data[REPORT_SIZE + 8 + sizeof bye] = {0};

    report.refresh = false;
    CHECK_EQUAL(report_write(data, &report), REPORT_SIZE);
    data[0] |= 0x20;
    data[3] += 2;
    for (unsigned padding = 0; padding < 256; padding++) {
        bool good = padding && padding % 4 == 0 && padding <= 28; /* header and both SSRCs remain */
        data[REPORT_SIZE + 7] = (uint8_t)padding;
        CHECK_EQUAL(parse(data, REPORT_SIZE + 8, &got), !good ? -EBADMSG : padding <= 8 ? 0 : -ENOMSG);
    }
    data[REPORT_SIZE + 7] = 8;
    memcpy(data + REPORT_SIZE + 8, bye, sizeof bye);
    CHECK_EQUAL(parse(data, sizeof data, &got), -EBADMSG);
}

static void check_garbage(void) {
    unsigned seed = 1;
    uint8_t data[REPORT_MAX];
    struct report got;

    for (unsigned round = 0; round < 20000; round++) {
        size_t size = report_write(data, &whole);
        for (unsigned flips = 0; flips < 1 + round % 3; flips++) {
            seed = seed * 1664525u + 1013904223u;
            data[(seed >> 16) % size] = (uint8_t)(seed >> 8);
        }
        int error = parse(data, size - round % 5, &got);
        unsigned known = (uint16_t)(got.highest + 1 - got.base);
        CHECK(error || !got.has_state || (known <= REPORT_WINDOW && got.missing <= known));
    }
}

int main(void) {
    struct report only = whole, without = whole, never = whole;

    only.has_state = without.refresh = never.has_repair = false;
    check_bytes();
    check_same(&whole);
    check_same(&only);
    check_same(&without);
    check_same(&never);
    check_ages();
    check_possible();
    check_others();
    check_padding();
    check_garbage();
    return 0;
}
