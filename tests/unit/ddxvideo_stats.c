/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Counters that add up, and a histogram that is accurate. tests/host has the tests with a store. */
#include <ddx_stats.h>

#include "check.h"

static const char *const reasons[] = {"store", "ring", NULL};

static void test_counting(void) {
    char line[DDX_STATS_LINE_MAX];
    DDX_STATS stats;
    DDX_STATS_BOOK *book = ddx_stats_open("tester", reasons);
    ddx_stats_in(book, 10, 12);
    ddx_stats_out(book, 4, 1500000);
    ddx_stats_lost(book, 0, 2);
    ddx_stats_lost(book, 1, 1);
    ddx_stats_skipped(book, 40);
    CHECK_EQUAL(ddx_stats_write(book), 0); /* no store: counts only */
    ddx_stats_get(book, &stats);
    CHECK_EQUAL(stats.in, 10);
    CHECK_EQUAL(stats.out, 4);
    CHECK_EQUAL(stats.waiting, 3);
    CHECK_EQUAL(stats.sequence, 12);
    CHECK_EQUAL(stats.running, 1);
    CHECK(stats.first > 0 && stats.first == stats.last);
    stats.first = 5;
    stats.last = 7;
    int length = ddx_stats_json(&stats, "tester", line, sizeof(line));
    CHECK_EQUAL(length, strlen(line));
    CHECK(!strcmp(line, "{\"instance\":\"tester\",\"in\":10,\"out\":4,\"waiting\":3,\"skipped\":40,"
                        "\"lost\":{\"store\":2,\"ring\":1,\"restart\":0},"
                        "\"latency_us\":{\"p50\":1488,\"p99\":1488,\"max\":1500},"
                        "\"latency_until\":\"out\","
                        "\"starts\":1,\"first_ns\":5,\"last_ns\":7}"));
    ddx_stats_latency_until(book, DDX_STATS_DISK);
    ddx_stats_get(book, &stats);
    ddx_stats_json(&stats, "tester", line, sizeof line);
    CHECK(strstr(line, "},\"latency_until\":\"disk\",\"starts\":1,"));
    CHECK_EQUAL(ddx_stats_follow(book, 13), 0); /* there was no predecessor */
    CHECK_EQUAL(ddx_stats_follow(book, 20), 7);
    CHECK_EQUAL(ddx_stats_follow(book, 5), 5); /* numbering has started again */
    ddx_stats_get(book, &stats);
    CHECK_EQUAL(stats.in, 22);
    CHECK_EQUAL(stats.lost[2].frames, 12);
    CHECK_EQUAL(stats.sequence, 5);
    ddx_stats_close(book);
    ddx_stats_close(NULL);
}

static void test_refusals(void) {
    const char *const too_many[] = {"a", "b", "c", "d", "e", "f", "g", "h", NULL};
    const char *const too_long[] = {"sixteen-letters-", NULL};
    char name[DDX_NAME_MAX + 2];
    memset(name, 'x', sizeof(name) - 1);
    name[sizeof(name) - 1] = 0;
    CHECK(!ddx_stats_open("tester", too_many));
    CHECK(!ddx_stats_open("tester", too_long));
    CHECK(!ddx_stats_open(name, reasons));
    CHECK(!ddx_stats_open("", reasons));
}

/* An item may contain anything; the output stays one line, within its bounds. */
static void test_hostile(void) {
    DDX_STATS stats;
    char line[DDX_STATS_LINE_MAX + 1];
    memset(&stats, 0xff, sizeof(stats));
    line[DDX_STATS_LINE_MAX] = 'x';
    CHECK(ddx_stats_json(&stats, "a\"b\n", line, DDX_STATS_LINE_MAX) < DDX_STATS_LINE_MAX);
    CHECK(!strchr(line, '\n') && strstr(line, "a\\u0022b\\u000a"));
    CHECK(ddx_stats_json(&stats, "name", line, 10) > 10);
    CHECK_EQUAL(strlen(line), 9);
    ddx_stats_json(&stats, "name", NULL, 0);
    CHECK_EQUAL(line[DDX_STATS_LINE_MAX], 'x');
}

static void test_accuracy(void) {
    DDX_STATS_BOOK *book = ddx_stats_open("tester", reasons);
    DDX_STATS stats;
    CHECK(book != NULL);
    ddx_stats_get(book, &stats);
    CHECK_EQUAL(ddx_stats_percentile(&stats, 0.5), 0);
    ddx_stats_close(book);

    for (int64_t us = 0; us < INT64_C(130000000); us = us * 103 / 100 + 1) {
        book = ddx_stats_open("tester", reasons);
        ddx_stats_out(book, 3, us * 1000 + 999);
        ddx_stats_out(book, 1, INT64_C(1000000000000)); /* so that the maximum does not hide an error */
        ddx_stats_get(book, &stats);
        int64_t found = (int64_t)ddx_stats_percentile(&stats, 0.5);
        CHECK(llabs(found - us) * 1000 <= us * 16);
        CHECK_EQUAL(ddx_stats_percentile(&stats, 0.99), 1000000000);
        CHECK_EQUAL(stats.latency_max, 1000000000);
        ddx_stats_close(book);
    }

    /* 1 to 100000 µs, each once */
    book = ddx_stats_open("tester", reasons);
    for (int64_t us = 1; us <= 100000; us++)
        ddx_stats_out(book, 1, us * 1000);
    ddx_stats_out(book, 1, -5);
    ddx_stats_get(book, &stats);
    CHECK(llabs((int64_t)ddx_stats_percentile(&stats, 0.50) - 50000) < 1000);
    CHECK(llabs((int64_t)ddx_stats_percentile(&stats, 0.99) - 99000) < 1980);
    CHECK_EQUAL(ddx_stats_percentile(&stats, 0), 0);
    CHECK(ddx_stats_percentile(&stats, 1) <= 100000);
    ddx_stats_close(book);
}

int main(void) {
    test_counting();
    test_refusals();
    test_hostile();
    test_accuracy();
    return 0;
}
