/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The logger's queue: values come out whole and in order; a value without room is refused, and nothing waits. */
#include "check.h"
#include "queue.h"

#include <ddx.h>

#define MESSAGES 50000
#define SIZE 4096

static struct queue queue;
static struct item *const some = (struct item *)(uintptr_t)64; /* never dereferenced */

static size_t size_of(uint64_t number) {
    return (size_t)(number * 2654435761u % 400);
}

static void *put_all(void *unused) {
    (void)unused;
    for (uint64_t number = 1; number <= MESSAGES;) {
        struct queue_entry *entry = queue_place(&queue, size_of(number));
        if (!entry)
            continue;
        entry->item = some;
        entry->sequence = number;
        memset(entry->data, (int)number, entry->size);
        queue_put(&queue);
        number++;
    }
    queue_close(&queue);
    return NULL;
}

static void test_two_threads(void) {
    pthread_t thread;
    bool end = false;
    uint64_t number = 0;
    CHECK_EQUAL(queue_init(&queue, SIZE), 0);
    CHECK_EQUAL(pthread_create(&thread, NULL, put_all, NULL), 0);
    while (!end) {
        struct queue_entry *entry = queue_next(&queue, ddx_time_now() + 5000000000, &end);
        if (!entry)
            continue;
        CHECK_EQUAL(entry->sequence, ++number);
        CHECK_EQUAL(entry->size, size_of(number));
        for (size_t i = 0; i < entry->size; i++)
            CHECK(entry->data[i] == (unsigned char)number);
        queue_take(&queue);
    }
    CHECK_EQUAL(number, MESSAGES);
    pthread_join(thread, NULL);
    queue_free(&queue);
}

static void test_full(void) {
    bool end;
    unsigned count = 0;
    CHECK_EQUAL(queue_init(&queue, SIZE), 0);
    CHECK(!queue_place(&queue, SIZE));
    CHECK(!queue_place(&queue, SIZE_MAX));
    for (struct queue_entry *entry; (entry = queue_place(&queue, 100)); count++) {
        entry->item = some;
        queue_put(&queue);
    }
    CHECK(count > SIZE / 200 && count < SIZE / 100);
    CHECK(queue_next(&queue, 0, &end) && !end);
    queue_take(&queue);
    CHECK(queue_place(&queue, 100));
    queue_put(&queue);
    CHECK(!queue_place(&queue, 100));
    queue_free(&queue);
}

static void test_waits_no_longer_than_told(void) {
    bool end = true;
    CHECK_EQUAL(queue_init(&queue, SIZE), 0);
    int64_t begin = ddx_time_now();
    CHECK(!queue_next(&queue, begin + 50000000, &end) && !end);
    CHECK(ddx_time_now() - begin >= 50000000);
    queue_close(&queue);
    CHECK(!queue_next(&queue, INT64_MAX, &end) && end);
    queue_free(&queue);
}

int main(void) {
    test_full();
    test_waits_no_longer_than_told();
    test_two_threads();
    return 0;
}
