/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A program that has not declared an item's type can look at the item in place, but the library copies nothing into or
 * out of a struct of unknown size.
 */
#include <errno.h>
#include <stdbool.h>

#include "ddx_request.h"
#include "store_process.h"

#define FILL 0xcc

DDX_STORE_TYPE(
    POSE, struct { double x, y; });

struct plain {
    int number[4];
};

static DDX_STORE_ID *id;

/* An item of a type that only its creator knows. */
static DDX_STORE_ITEM *create(const char *name, const char *declaration, const struct ddx_extent *extent) {
    struct ddx_item_spec spec = {
        .name = name, .type = "BIG", .declaration = declaration, .extents = extent, .extent_count = extent ? 1 : 0};
    DDX_STORE_ITEM *item;

    CHECK_EQUAL(ddx_store_create(id, &spec, &item), 0);
    return item;
}

static void publish(DDX_STORE_ITEM *item, int number) {
    void *data;

    CHECK_EQUAL(ddx_store_loan(item, &data), 0);
    memcpy(data, &number, sizeof number);
    CHECK_EQUAL(ddx_store_publish(item, NULL), 0);
}

/* A failed read does not change the caller's struct or the bytes after it. */
static void read_is_refused(DDX_STORE_ITEM *item, double timeout) {
    static struct {
        POSE pose;
        unsigned char beyond[4096];
    } here;

    memset(&here, FILL, sizeof here);
    CHECK_EQUAL(ddx_store_read(item, &here.pose, NULL, timeout, DDX_NEXT), -EPROTOTYPE);
    for (size_t i = 0; i < sizeof here; i++)
        CHECK_EQUAL(((unsigned char *)&here)[i], FILL);
}

static void test_read(void) {
    DDX_STORE_ITEM *out = create("other", "struct { int a[512]; }", NULL);
    DDX_STORE_ITEM *in = ddx_store_lookup_item(id, "other", NULL, 0); /* by mistake */
    struct ddx_item_info info;
    struct ddx_frame frame;

    CHECK(in);
    read_is_refused(in, 0);
    CHECK_EQUAL(ddx_store_item_info(in, &info), 0);
    CHECK_EQUAL(info.readers, 0); /* no reader was added */
    CHECK_EQUAL(ddx_store_acquire(in, &frame, 0, DDX_IN_ORDER), -ETIMEDOUT);
    publish(out, 7);
    read_is_refused(in, 0);
    CHECK_EQUAL(ddx_store_acquire(in, &frame, 0, DDX_IN_ORDER), 0); /* the refused read has not taken it */
    CHECK_EQUAL(*(const int *)frame.data, 7);
    CHECK_EQUAL(ddx_store_release(in), 0);
    CHECK_EQUAL(ddx_store_read_direct(in, NULL, 0, DDX_CURRENT), 0);
    CHECK_EQUAL(*(const int *)ddx_store_var_pointer(in), 7);
    CHECK_EQUAL(ddx_store_field_named(in, "a")->count, 512);
    ddx_store_done_item(in);
    ddx_store_done_item(out);
}

/* A handle that cannot write must not take the writer's role. */
static void test_write(void) {
    DDX_STORE_ITEM *out = create("other", "struct { int a[512]; }", NULL);
    DDX_STORE_ITEM *in = ddx_store_lookup_item(id, "other", NULL, 0);
    struct ddx_item_info before, after;
    POSE pose = {1, 2};

    ddx_store_done_item(out);
    CHECK_EQUAL(ddx_store_item_info(in, &before), 0);
    CHECK_EQUAL(ddx_store_write(in, &pose, NULL), -EPROTOTYPE);
    CHECK_EQUAL(ddx_store_item_info(in, &after), 0);
    CHECK_EQUAL(after.epoch, before.epoch);
    publish(in, 8); /* writing in place is allowed */
    CHECK_EQUAL(ddx_store_write(in, &pose, NULL), -EPROTOTYPE);
    publish(in, 9);
    CHECK_EQUAL(ddx_store_written(in), 3); /* 7, 8 and 9 */
    ddx_store_done_item(in);
}

/* The type is unknown until the item exists. */
static void test_awaited(void) {
    DDX_STORE_ITEM *in = ddx_store_await_item(id, "later");
    struct ddx_frame frame;
    POSE pose = {1, 2};

    CHECK(in);
    CHECK_EQUAL(ddx_store_read(in, &pose, NULL, 0, DDX_NEXT), -ETIMEDOUT);
    DDX_STORE_ITEM *out = create("later", "struct { int a[512]; }", NULL);
    publish(out, 1);
    read_is_refused(in, 5);
    read_is_refused(in, 0);
    CHECK_EQUAL(ddx_store_write(in, &pose, NULL), -EPROTOTYPE);
    CHECK_EQUAL(ddx_store_acquire(in, &frame, 0, DDX_CURRENT), 0);
    ddx_store_done_item(in);
    ddx_store_done_item(out);
}

/* A plain C type is known by its name; a type with a size counts as a struct. */
static void test_known(void) {
    struct ddx_item_spec spec = {.name = "video.frame", .type = "int", .declaration = "int"};
    int number = 5, got = 0;
    struct plain plain = {{1, 2, 3, 4}}, copy = {{0}};
    DDX_STORE_ITEM *out;

    CHECK_EQUAL(ddx_store_create(id, &spec, &out), 0);
    CHECK_EQUAL(ddx_store_write(out, &number, NULL), 0);
    DDX_STORE_ITEM *in = ddx_store_lookup_item(id, "video.frame", NULL, 0);
    CHECK_EQUAL(ddx_store_read(in, &got, NULL, 0, DDX_CURRENT), 0);
    CHECK_EQUAL(got, number);
    ddx_store_done_item(out);
    number = 6;
    CHECK_EQUAL(ddx_store_write(in, &number, NULL), 0);
    in = ddx_store_lookup_item(id, "plain", "PLAIN", sizeof plain);
    CHECK_EQUAL(ddx_store_write(in, &plain, NULL), 0);
    CHECK_EQUAL(ddx_store_read(in, &copy, NULL, 0, DDX_CURRENT), 0);
    CHECK(!memcmp(&copy, &plain, sizeof plain));
}

/* With a size alone, the used parts of an item with extents are copied to the same places, if the size is right. */
static void test_size_alone(void) {
    const struct ddx_extent extent = {"bytes", 8};
    DDX_STORE_ITEM *out = create("partly", "struct { int number; char bytes[100]; int after; }", &extent);
    struct {
        int number;
        char bytes[100];
        int after;
    } got = {0};

    publish(out, 7);
    CHECK(!ddx_store_lookup_item(id, "partly", "BIG", 64));
    CHECK_EQUAL(errno, EMSGSIZE);
    DDX_STORE_ITEM *in = ddx_store_lookup_item(id, "partly", "BIG", sizeof got);
    CHECK(in);
    memset(got.bytes, FILL, sizeof got.bytes);
    CHECK_EQUAL(ddx_store_read(in, &got, NULL, 0, DDX_CURRENT), 0);
    CHECK_EQUAL(got.number, 7);
    CHECK_EQUAL((unsigned char)got.bytes[8], FILL);
}

/* The library reads answers into its own struct, so an item that has only the name of an answer is refused. */
static void test_answer_of_another_type(void) {
    struct ddx_item_spec spec = {.name = "camera.answer", .type = "BIG", .declaration = "struct { int a[512]; }"};
    DDX_STORE_ITEM *answer;

    CHECK_EQUAL(ddx_store_create(id, &spec, &answer), 0);
    CHECK(ddx_store_lookup_item(id, "camera.request", "DDX_REQUEST", sizeof(DDX_REQUEST)));
    CHECK_EQUAL(ddx_request_possible(id, "camera"), 0);
}

int main(void) {
    store_folder_make();
    store_start("16M");
    id = ddx_store_open(NULL, 0, 10);
    CHECK(id);
    test_read();
    test_write();
    test_awaited();
    test_known();
    test_size_alone();
    test_answer_of_another_type();
    ddx_store_close(id);
    store_stop(SIGTERM);
    return 0;
}
