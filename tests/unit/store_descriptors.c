/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A store whose descriptors run short: items that no client has open are dropped for a connection, a writer or a
 * reader, counters last; where that does not help, new programs wait until descriptors are free.
 */
#include <errno.h>
#include <poll.h>
#include <stdbool.h>

#include "../../package/ddx/lib/wire.h"
#include "store_process.h"

#define LIMIT 256
#define NEWCOMERS 10
#define PATIENCE 10000 /* ms, and steps of one of them: for a machine that hangs */

DDX_STORE_TYPE(
    SMALL, struct { unsigned word[16]; });

static DDX_STORE_ID *id;

static void begin(void) {
    store_start_with("16M", LIMIT);
    id = ddx_store_open(NULL, 0, 10);
    CHECK(id);
}

static void end(void) {
    ddx_store_close(id);
    store_stop(SIGKILL);
    scratch_clear(); /* so that the next store inherits nothing */
}

/* Written once, by this handle. */
static DDX_STORE_ITEM *create(const char *name) {
    static const SMALL value;
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, "SMALL", sizeof value);

    CHECK(item);
    CHECK_EQUAL(ddx_store_write(item, &value, NULL), 0);
    return item;
}

/*
 * A reader for which that number of frames is kept, or as many as there are descriptors: a frame needs one.
 */
static DDX_STORE_ITEM *reader_of(const char *name, unsigned frames) {
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, NULL, 0);
    SMALL value;

    CHECK(item);
    CHECK_EQUAL(ddx_store_read(item, &value, NULL, 0, DDX_CURRENT), 0);
    for (unsigned step = 128; step; step /= 2)
        while (ddx_store_kept(item) + step <= frames && !ddx_store_keep(item, ddx_store_kept(item) + step))
            continue;
    return item;
}

static bool exists(const char *name) {
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, NULL, 0);

    ddx_store_done_item(item);
    return item != NULL;
}

/* With that number of frames; no client has it open any more. */
static void leave(const char *name, unsigned frames) {
    DDX_STORE_ITEM *out = create(name), *in = reader_of(name, frames);

    CHECK_EQUAL(ddx_store_kept(in), frames);
    ddx_store_done_item(in);
    ddx_store_done_item(out);
}

/* The counters of a program that has exited, older than all other items. */
static void leave_counters(void) {
    const struct ddx_item_spec spec = {.name = "gone.stats", .type = "DDX_STATS", .declaration = "struct { int in; }"};
    DDX_STORE_ITEM *item;
    void *data;

    CHECK_EQUAL(ddx_store_create(id, &spec, &item), 0);
    CHECK_EQUAL(ddx_store_loan(item, &data), 0);
    memset(data, 0, sizeof(int));
    CHECK_EQUAL(ddx_store_publish(item, NULL), 0);
    ddx_store_done_item(item);
}

/* More than three quarters of the descriptors are in use, so that no connection would be taken. */
static void test_dropped_for_a_connection(void) {
    begin();
    leave_counters();
    leave("left", LIMIT / 4 * 3);
    for (unsigned i = 0; i < NEWCOMERS; i++) { /* some replace those that left */
        char name[16];

        snprintf(name, sizeof name, "newcomer%u", i);
        create(name);
    }
    CHECK(!exists("left"));
    CHECK(exists("gone.stats"));
    end();
}

static void test_dropped_for_a_reader(void) {
    begin();
    leave_counters();
    DDX_STORE_ITEM *out = create("read");
    leave("left", 110);
    leave("later", 10);
    DDX_STORE_ITEM *in = reader_of("read", 130);
    CHECK_EQUAL(ddx_store_kept(in), 130);
    CHECK(!exists("left"));
    CHECK(exists("later")); /* one is enough */
    CHECK(exists("gone.stats"));
    ddx_store_done_item(out);
    end();
}

static void test_dropped_for_a_writer(void) {
    begin();
    leave("left", 120);
    DDX_STORE_ITEM *in = ddx_store_await_item(id, "awaited");
    SMALL value;
    CHECK_EQUAL(ddx_store_keep(in, 150), 0);
    CHECK_EQUAL(ddx_store_read(in, &value, NULL, 0, DDX_NEXT), -ETIMEDOUT);
    CHECK(exists("left"));
    DDX_STORE_ITEM *out = create("awaited");
    CHECK_EQUAL(ddx_store_read(in, &value, NULL, 0, DDX_NEXT), 0);
    CHECK(!exists("left"));
    ddx_store_done_item(out);
    end();
}

/* A writer may give its frames any time stamp: its item is dropped nevertheless. */
static void test_dropped_whatever_its_time(void) {
    static const SMALL value;
    const DDX_TIME never = INT64_MAX;

    begin();
    DDX_STORE_ITEM *out = create("left"), *in = reader_of("left", 120);
    CHECK_EQUAL(ddx_store_write(out, &value, &never), 0);
    ddx_store_done_item(in);
    ddx_store_done_item(out);
    out = create("read");
    in = reader_of("read", 130);
    CHECK_EQUAL(ddx_store_kept(in), 130);
    CHECK(!exists("left"));
    ddx_store_done_item(out);
    end();
}

/* An impossible request does not cost any item its last value. */
static void test_nothing_is_dropped_in_vain(void) {
    begin();
    leave("left", 20);
    DDX_STORE_ITEM *out = create("read"), *in = reader_of("read", 100);
    CHECK_EQUAL(ddx_store_keep(in, 250), -EBUSY);
    CHECK(exists("left"));
    ddx_store_done_item(out);
    end();
}

/* No descriptor is left, not even for a connection. */
static void test_newcomers_wait(void) {
    static struct ddx_packet packet;
    struct ddx_message message = {.operation = DDX_LIST};

    begin();
    DDX_STORE_ITEM *out = create("all"), *in = reader_of("all", LIMIT);
    CHECK(out && ddx_store_kept(in) < LIMIT - 10);
    int newcomer = ddx_connect(DDX_STORE_PORT);
    CHECK(newcomer >= 0);
    CHECK_EQUAL(ddx_send(newcomer, &message, NULL, NULL, 0), 0);
    unsigned long before = store_sleeps();
    for (int i = 0; store_sleeps() < before + 2; i++) { /* a store that loops without a pause never sleeps */
        CHECK(i < PATIENCE);
        poll(NULL, 0, 1);
    }
    ddx_store_done_item(in);
    struct pollfd answer = {.fd = newcomer, .events = POLLIN};
    CHECK_EQUAL(poll(&answer, 1, PATIENCE), 1);
    CHECK_EQUAL(ddx_receive(newcomer, &packet), 1);
    close(newcomer);
    end();
}

int main(void) {
    struct rlimit limit;

    CHECK_EQUAL(getrlimit(RLIMIT_NOFILE, &limit), 0);
    limit.rlim_cur = limit.rlim_max; /* writer and reader have a descriptor for each frame, too */
    CHECK_EQUAL(setrlimit(RLIMIT_NOFILE, &limit), 0);
    store_folder_make();
    test_dropped_for_a_connection();
    test_dropped_for_a_reader();
    test_dropped_for_a_writer();
    test_dropped_whatever_its_time();
    test_nothing_is_dropped_in_vain();
    test_newcomers_wait();
    return 0;
}
