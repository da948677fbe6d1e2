/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Frames that come in the wrong order leave in the right one, or are dropped and counted as lost, never both. */
#include "check.h"
#include "frame_count.h"
#include "reorder.h"

#define WAIT 20

static struct order order;
static int64_t now;

/* The frames that leave now, as a text of their numbers (which are their slots). */
static const char *gone(void) {
    static char text[100];
    unsigned slot;
    *text = 0;
    while (order_next(&order, now, WAIT, &slot))
        sprintf(text + strlen(text), "%s%u", *text ? " " : "", slot);
    return text;
}

static const char *come(uint32_t number) {
    return order_add(&order, number, number, now) ? gone() : "late";
}

static void is(const char *found, const char *wanted) {
    if (strcmp(found, wanted) != 0) {
        fprintf(stderr, "%s instead of %s\n", found, wanted);
        exit(1);
    }
}

static void test_exchanged(void) {
    order_restart(&order);
    is(come(33), "33");
    is(come(35), "");
    CHECK_EQUAL(order_due(&order, WAIT), now + WAIT);
    is(come(34), "34 35");
    is(come(36), "36");
    CHECK_EQUAL(order_due(&order, WAIT), INT64_MAX);
}

static void test_lost(void) {
    order_restart(&order);
    is(come(1), "1");
    is(come(3), "");
    now += WAIT - 1;
    is(gone(), "");
    now++;
    is(gone(), "3");
    is(come(2), "late");
    is(come(4), "4");
    is(come(4 + ORDER_FAR + 1), "13"); /* no earlier frame can still come */
    is(come(15), "");
    is(come(17), "");
    is(come(16), "15 16 17"); /* too many to wait */
    is(come(14), "late");
}

static void test_numbers_that_do_not_rise(void) {
    order_restart(&order);
    is(come(25), "25");
    is(come(24), "late"); /* the first one may have overtaken it; unknown */
    is(come(25), "25");   /* a driver that does not count */
    is(come(27), "");
    is(come(26), "26 27");
    is(come(0), "0"); /* numbering starts again: frames this far below were not missed */
    is(come(1), "1");
    order_restart(&order);
    is(come(7), "7");
}

static void test_wrap(void) {
    unsigned slot;
    order_restart(&order);
    CHECK(order_add(&order, UINT32_MAX - 1, 0, now) && order_next(&order, now, WAIT, &slot));
    CHECK(order_add(&order, 0, 1, now) && !order_next(&order, now, WAIT, &slot));
    CHECK(order_add(&order, UINT32_MAX, 2, now));
    CHECK(order_next(&order, now, WAIT, &slot) && slot == 2);
    CHECK(order_next(&order, now, WAIT, &slot) && slot == 1);
}

/* Random losses and exchanges: numbers that leave rise, and lost + left are all frames so far. */
static void test_random(int64_t wait) {
    struct count count = {.skip = 1};
    uint64_t lost = 0, passed = 0, dropped = 0, first = 0, last = 0;
    order_restart(&order);
    srand(7);
    for (uint32_t number = 0; number < 20000;) {
        uint32_t some[2] = {number, number + 1}; /* the two come in this order, or in the other, or not at all */
        bool swapped = rand() % 3 == 0;
        for (int i = 0; i < 2; i++) {
            unsigned slot;
            uint64_t position;
            bool wanted;
            uint32_t one = some[swapped ? 1 - i : i];
            now += rand() % 12;
            if (rand() % 10 == 0)
                continue;
            dropped += !order_add(&order, one, one, now);
            while (order_next(&order, now, wait, &slot)) {
                CHECK(!passed || slot > last);
                first = passed ? first : slot;
                last = slot;
                lost += count_frame(&count, slot, &wanted, &position);
                passed++;
                CHECK_EQUAL(passed + lost, last - first + 1);
            }
        }
        number += 2;
    }
    CHECK(passed > 15000);
    CHECK(wait ? dropped <= 1 : dropped > 1000); /* without patience; and one before the very first */
}

int main(void) {
    test_exchanged();
    test_lost();
    test_numbers_that_do_not_rise();
    test_wrap();
    test_random(WAIT);
    test_random(0);
    return 0;
}
