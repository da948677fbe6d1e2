/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Readers that exist before the item: they get every value from the first one on, and never keep a writer from writing.
 */
#include <errno.h>
#include <time.h>

#include "store_process.h"

DDX_STORE_TYPE(
    POSITION, struct {
        int number;
        double x, y;
    });
DDX_STORE_TYPE(
    BLOCK, struct {
        int number;
        char bytes[1000000];
    });

#define FIRST 6 /* values that are written before the reader looks */

static DDX_STORE_ID *id;

static DDX_STORE_ITEM *await(const char *name, unsigned keep) {
    DDX_STORE_ITEM *item = ddx_store_await_item(id, name);
    struct ddx_frame frame;

    CHECK(item);
    CHECK_EQUAL(ddx_store_keep(item, keep), 0);
    CHECK_EQUAL(ddx_store_acquire(item, &frame, 0, DDX_IN_ORDER), -ETIMEDOUT);
    return item;
}

static DDX_STORE_ITEM *write_first(const char *name) {
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, "POSITION", sizeof(POSITION));
    POSITION value = {0};

    CHECK(item);
    for (value.number = 1; value.number <= FIRST; value.number++)
        CHECK_EQUAL(ddx_store_write(item, &value, NULL), 0);
    return item;
}

static void read_first(DDX_STORE_ITEM *item) {
    struct ddx_frame frame;

    for (int number = 1; number <= FIRST; number++) {
        CHECK_EQUAL(ddx_store_acquire(item, &frame, 1, DDX_IN_ORDER), 0);
        CHECK_EQUAL(frame.sequence, (uint64_t)number);
        CHECK_EQUAL(frame.missed, 0);
        CHECK_EQUAL(((const POSITION *)frame.data)->number, number);
        CHECK_EQUAL(ddx_store_release(item), 0);
    }
}

/* Before it is created, the item exists only for readers that wait for it. */
static void test_unseen(void) {
    DDX_STORE_ITEM *in = await("unseen", 1);
    struct ddx_item_info info;
    POSITION value = {0};

    CHECK_EQUAL(*ddx_store_item_type(in), 0);
    CHECK(!ddx_store_field(in, 0));
    CHECK(!ddx_store_field_named(in, "number"));
    CHECK_EQUAL(ddx_store_write(in, &value, NULL), -ENOENT);
    CHECK_EQUAL(ddx_store_item_info(in, &info), 0);
    CHECK_EQUAL(*info.type, 0);
    CHECK_EQUAL(ddx_store_read(in, &value, NULL, 0.01, DDX_NEXT), -ETIMEDOUT);
    CHECK(!ddx_store_lookup_item(id, "unseen", NULL, 0));
    CHECK_EQUAL(errno, ENOENT);
    struct ddx_item_info *items;
    unsigned count;
    CHECK_EQUAL(ddx_store_list(id, NULL, &items, &count), 0);
    for (unsigned i = 0; i < count; i++)
        CHECK(strcmp(items[i].name, "unseen") != 0);
    free(items);
    ddx_store_done_item(in);
    DDX_STORE_ITEM *out = ddx_store_lookup_item(id, "unseen", "int", sizeof(int)); /* the item no longer exists */
    CHECK(out);
    ddx_store_done_item(out);
}

static void test_from_the_first(void) {
    DDX_STORE_ITEM *in = await("first", FIRST), *other = await("first", FIRST), *gone = await("first", 1);
    POSITION value;

    ddx_store_done_item(gone);
    DDX_STORE_ITEM *out = write_first("first");
    read_first(in);
    read_first(other);
    CHECK_EQUAL(ddx_store_kept(in), FIRST);
    CHECK_EQUAL(strcmp(ddx_store_item_type(in), "POSITION"), 0);
    CHECK(ddx_store_field_named(in, "x"));
    CHECK_EQUAL(ddx_store_read(in, &value, NULL, 0, DDX_CURRENT), 0);
    CHECK_EQUAL(value.number, FIRST);
    DDX_STORE_ITEM *late = ddx_store_await_item(id, "first"); /* like any late reader */
    CHECK(late);
    CHECK_EQUAL(strcmp(ddx_store_item_type(late), "POSITION"), 0);
    CHECK_EQUAL(ddx_store_read(late, &value, NULL, 0, DDX_NEXT), -ETIMEDOUT);
    ddx_store_done_item(late);
    ddx_store_done_item(other);
    ddx_store_done_item(out);
    ddx_store_done_item(in);
}

/* Programs that await it, and one that created it without writing, report to a new store in any order. */
static void test_restart(void) {
    DDX_STORE_ITEM *in = await("again", FIRST), *before = await("typed", FIRST);
    DDX_STORE_ITEM *typed = ddx_store_lookup_item(id, "typed", "POSITION", sizeof(POSITION));

    CHECK(typed);
    store_stop(SIGKILL);
    store_start("64M");
    nanosleep(&(struct timespec){.tv_nsec = 500000000}, NULL);
    DDX_STORE_ITEM *out = write_first("again"), *other = write_first("typed");
    read_first(in);
    read_first(before);
    store_stop(SIGKILL); /* now they hold the item and know its type */
    store_start("64M");
    POSITION value = {.number = FIRST + 1};
    CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
    CHECK_EQUAL(ddx_store_read(in, &value, NULL, 1, DDX_IN_ORDER), 0);
    nanosleep(&(struct timespec){.tv_nsec = 500000000}, NULL);
    DDX_STORE_ITEM *late = ddx_store_lookup_item(id, "again", NULL, 0);
    CHECK(late);
    CHECK_EQUAL(strcmp(ddx_store_item_type(late), "POSITION"), 0);
    ddx_store_done_item(late);
    ddx_store_done_item(typed);
    ddx_store_done_item(before);
    ddx_store_done_item(other);
    ddx_store_done_item(out);
    ddx_store_done_item(in);
}

/*
 * The size of the frames was unknown: the writer gets its memory, waiting readers keep fewer frames, and other readers
 * are admitted.
 */
static void test_little_room(void) {
    static BLOCK value;
    DDX_STORE_ITEM *in = await("large", 25);
    struct ddx_frame frame;
    uint64_t seen = 0, missed = 0;

    DDX_STORE_ITEM *out = ddx_store_lookup_item(id, "large", "BLOCK", sizeof(BLOCK));
    CHECK(out);
    for (value.number = 1; value.number <= 40; value.number++)
        CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
    while (!ddx_store_acquire(in, &frame, 0, DDX_IN_ORDER)) {
        seen++;
        missed += frame.missed;
        CHECK_EQUAL(ddx_store_release(in), 0);
    }
    CHECK(seen >= 6 && seen < 25);
    CHECK(ddx_store_kept(in) >= 6 && ddx_store_kept(in) <= seen);
    CHECK_EQUAL(seen + missed, 40);
    DDX_STORE_ITEM *late = ddx_store_lookup_item(id, "large", NULL, 0);
    CHECK(late);
    CHECK_EQUAL(ddx_store_acquire(late, &frame, 0, DDX_CURRENT), 0);
    ddx_store_done_item(late);
    ddx_store_done_item(out);
    /* A later writer, also after a restart of the store, finds the memory as well. */
    store_stop(SIGKILL);
    store_start("32M");
    nanosleep(&(struct timespec){.tv_nsec = 500000000}, NULL);
    out = ddx_store_lookup_item(id, "large", "BLOCK", sizeof(BLOCK));
    CHECK(out);
    CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
    CHECK_EQUAL(ddx_store_acquire(in, &frame, 1, DDX_IN_ORDER), 0);
    ddx_store_done_item(out);
    ddx_store_done_item(in);
}

int main(void) {
    store_folder_make();
    store_start("64M");
    id = ddx_store_open(NULL, 0, 2);
    CHECK(id);
    test_unseen();
    test_from_the_first();
    test_restart();
    store_stop(SIGTERM);
    ddx_store_close(id);
    store_start("32M");
    id = ddx_store_open(NULL, 0, 2);
    CHECK(id);
    test_little_room();
    ddx_store_close(id);
    store_stop(SIGTERM);
    return 0;
}
