/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Times and contents of reports. */
#include "reporter.h"

#include "bits.h"

#include "check.h"

#define MS INT64_C(1000000)
#define SSRC 7u
#define INTERVAL (40 * MS)

static struct restore restore;
static struct reporter reporter;
static int64_t now;

static void begin(void) {
    now = 1000 * MS;
    restore_init(&restore, SSRC);
    reporter_init(&reporter, 1, SSRC, 28, now);
}

static void media(uint16_t sequence, uint32_t frame, bool marker) {
    uint8_t data[20];
    struct rtp_packet packet = {
        .type = RTP_H264, .marker = marker, .sequence = sequence, .time = frame * 3600, .ssrc = SSRC};
    size_t size = rtp_write(data, &packet);

    data[size++] = 1;
    CHECK_EQUAL(restore_source(&restore, data, size), 0);
    reporter_media(&reporter, now, sequence, packet.time, marker);
}

/* The next report, due at this time. */
static struct report next(int64_t due) {
    uint8_t data[REPORT_MAX];
    struct report report;

    int64_t deadline = reporter_deadline(&reporter, &restore);

    CHECK_EQUAL(deadline > now ? deadline : now, due);
    now = due;
    size_t size = reporter_next(&reporter, now, &restore, data);
    CHECK(size);
    CHECK_EQUAL(report_parse(data, size, &report), 0);
    CHECK_EQUAL(reporter_next(&reporter, now, &restore, data), 0);
    return report;
}

static void check_nothing_missing(void) {
    begin();
    CHECK_EQUAL(reporter_deadline(&reporter, &restore), INT64_MAX);
    media(65535, 0, true);
    int64_t came = now;
    struct report report = next(came);
    CHECK_EQUAL(report.highest, 65535);
    CHECK_EQUAL(report.base, 0);
    CHECK_EQUAL(report.missing, 0);
    CHECK_EQUAL(report.age, 0);
    CHECK(!report.has_repair);
    report = next(came + REPORTER_REPEAT_NS);
    CHECK_EQUAL(report.age, REPORTER_REPEAT_NS);
    /* the next frame does not come: reports until the sender counts as silent */
    int64_t due = came + INTERVAL + 4 * MS;
    unsigned reports = 0;
    for (; reporter_deadline(&reporter, &restore) != INT64_MAX; reports++) {
        report = next(reports ? reporter_deadline(&reporter, &restore) : due);
        CHECK_EQUAL(report.highest, 65535);
    }
    CHECK(now <= came + REPORTER_QUIET_NS + 20 * MS && now > came + REPORTER_QUIET_NS - 50 * MS);
    CHECK(reports > 20);
}

static void check_missing(void) {
    begin();
    media(10, 0, true);
    now += 2 * INTERVAL;
    media(12, 2, true);
    int64_t came = now;
    struct report report = next(came);
    CHECK_EQUAL(report.base, 11);
    CHECK_EQUAL(report.highest, 12);
    CHECK_EQUAL(report.missing, 1);
    CHECK_EQUAL(report.loss, 255 / 3);
    reporter.refresh = true;
    for (int i = 1; i < 5; i++)
        CHECK(next(came + i * REPORTER_REPEAT_NS).refresh);
    reporter_repair(&reporter, now, 500);
    report = next(now);
    CHECK(report.has_repair);
    CHECK_EQUAL(report.highest_repair, 500);
    CHECK_EQUAL(report.age, 0);
}

/* The rest of a frame is due at once. */
static void check_open_frame(void) {
    begin();
    media(10, 0, false);
    int64_t came = now;
    next(came);
    for (int i = 1; i < 4; i++)
        CHECK_EQUAL(next(came + i * REPORTER_REPEAT_NS).age, i * REPORTER_REPEAT_NS);
    media(11, 0, true);
    next(now);
    next(now + REPORTER_REPEAT_NS);
    CHECK(reporter_deadline(&reporter, &restore) >= came + INTERVAL);
}

/* 2,000 packets a second, every other one missing: 60 kbit/s, and 0.32 s more from the full bucket. */
static void check_rate(void) {
    uint8_t data[REPORT_MAX];
    size_t bytes = 0, size;

    begin();
    for (unsigned i = 0; i < 20000; i++) {
        now += MS / 2;
        media((uint16_t)(i * 2), i, true);
        while ((size = reporter_next(&reporter, now, &restore, data)))
            bytes += size + 28;
    }
    CHECK(bytes * 8 <= 10.32 * 60000 && bytes * 8 > 10.32 * 56000);
}

/* A time stamp far ahead or back, and a clock that stands still. */
static void check_times(void) {
    begin();
    for (unsigned i = 0; i < 1000; i++) {
        media((uint16_t)i, i * 0x9E3779B9u, i % 3);
        now += i % 4 ? 0 : MS;
        uint8_t data[REPORT_MAX];
        reporter_next(&reporter, now, &restore, data);
        CHECK(reporter.interval > 0);
    }
}

int main(void) {
    check_nothing_missing();
    check_missing();
    check_open_frame();
    check_rate();
    check_times();
    return 0;
}
