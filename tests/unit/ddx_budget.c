/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Reserved memory never exceeds -m, and no item is dropped in vain. */
#include <errno.h>
#include <poll.h>
#include <time.h>

#include "../../package/ddx/lib/memory.h"
#include "../../package/ddx/lib/wire.h"
#include "store_process.h"

#define READERS 30
#define FIELDS 200 /* as many as a type may have */
#define WIDE 300   /* items, more than one program gets */

static DDX_STORE_ID *id;

static void begin(const char *budget) {
    store_start(budget);
    id = ddx_store_open(NULL, 0, 10);
    CHECK(id);
}

static void end(void) {
    ddx_store_close(id);
    store_stop(SIGKILL);
    scratch_clear(); /* so that the next store inherits nothing */
}

static DDX_STORE_ITEM *create(const char *name, size_t bytes, size_t used) {
    struct ddx_extent extent = {"bytes", used};
    struct ddx_item_spec spec = {.name = name, .type = "BYTES", .extents = &extent, .extent_count = used ? 1 : 0};
    char declaration[64];
    DDX_STORE_ITEM *item;

    snprintf(declaration, sizeof declaration, "struct { char bytes[%zu]; }", bytes);
    spec.declaration = declaration;
    int result = ddx_store_create(id, &spec, &item);
    errno = -result;
    return result ? NULL : item;
}

static struct ddx_store_info all(void) {
    struct ddx_store_info info;
    struct ddx_item_info *items;
    unsigned count;

    CHECK_EQUAL(ddx_store_list(id, &info, &items, &count), 0);
    free(items);
    return info;
}

/* A request that no dropping of items can meet drops none. */
static void test_too_much(void) {
    begin("1M");
    DDX_STORE_ITEM *item = create("last", 4096, 0);
    void *data;
    CHECK_EQUAL(ddx_store_loan(item, &data), 0);
    CHECK_EQUAL(ddx_store_publish(item, NULL), 0);
    ddx_store_done_item(item);
    CHECK(!create("huge", 16000000, 0));
    CHECK_EQUAL(errno, ENOSPC);
    item = ddx_store_lookup_item(id, "last", NULL, 0);
    CHECK(item);
    ddx_store_done_item(item);
    item = create("large", 200000, 0); /* this request can be met */
    CHECK(item);
    end();
}

/* An item with the longest possible declaration. */
static DDX_STORE_ITEM *create_wide(unsigned number) {
    static char declaration[FIELDS * 16 + 16];
    struct ddx_item_spec spec = {.type = "WIDE", .declaration = declaration};
    char name[16];
    DDX_STORE_ITEM *item;

    size_t end = (size_t)sprintf(declaration, "struct {");
    for (unsigned i = 0; i < FIELDS; i++)
        end += (size_t)sprintf(declaration + end, " int f%u;", i);
    strcpy(declaration + end, " }");
    snprintf(name, sizeof name, "wide%u", number);
    spec.name = name;
    int result = ddx_store_create(id, &spec, &item);
    errno = -result;
    return result ? NULL : item;
}

static void write_one(DDX_STORE_ITEM *item) {
    void *data;

    CHECK_EQUAL(ddx_store_loan(item, &data), 0);
    CHECK_EQUAL(ddx_store_publish(item, NULL), 0);
}

/* A process that creates an item on request. To be called before this process has threads. */
static pid_t another_program(int told) {
    pid_t child = fork();
    char word;

    CHECK(child >= 0);
    if (child)
        return child;
    CHECK_EQUAL(read(told, &word, 1), 1);
    id = ddx_store_open(NULL, 0, 10);
    _exit(id && create_wide(WIDE) ? 0 : 1);
}

/*
 * One program gets a share of the store's memory for names and types, and an error beyond it; items that it has left
 * are dropped.
 */
static void test_one_program(void) {
    static DDX_STORE_ITEM *item[WIDE];
    unsigned count = 0;
    int status, tell[2];

    CHECK_EQUAL(pipe(tell), 0);
    pid_t other = another_program(tell[0]);
    begin("64M");
    while (count < WIDE && (item[count] = create_wide(count)))
        count++;
    CHECK_EQUAL(errno, EDQUOT);
    CHECK(count >= 100 && count < WIDE);
    CHECK(strstr(ddx_error_text(EDQUOT), "close some of them"));
    CHECK(!create_wide(count) && errno == EDQUOT);
    CHECK_EQUAL(write(tell[1], "", 1), 1);
    CHECK_EQUAL(waitpid(other, &status, 0), other);
    CHECK_EQUAL(status, 0);
    for (unsigned i = 0; i < 10; i++) {
        write_one(item[i]);
        ddx_store_done_item(item[i]);
    }
    CHECK(create_wide(count));
    for (unsigned i = 10; i < count; i++)
        write_one(item[i]);
    end();
}

/* Readers of an item that was never written have a page each. */
static void test_pages(void) {
    DDX_STORE_ITEM *item[READERS];
    int result = 0, value;

    begin("64K");
    for (unsigned i = 0; i < READERS; i++) {
        item[i] = ddx_store_lookup_item(id, "empty", "int", sizeof value);
        CHECK(item[i]);
        result = ddx_store_read(item[i], &value, NULL, 0, DDX_CURRENT);
        CHECK_EQUAL(result, i < 16 ? -ETIMEDOUT : -EBUSY);
        CHECK(all().reserved <= all().budget);
    }
    end();
}

/* While the next writer prepares, its memory is reserved. */
static void test_getting_ready(void) {
    struct ddx_message message = {.operation = DDX_OPEN, .name = "item"};
    static struct ddx_packet packet;

    begin("4M");
    ddx_store_done_item(create("item", 800000, 4096));
    DDX_STORE_ITEM *model = create("model", 800000, 400000);
    int probe = ddx_connect(DDX_STORE_PORT);
    CHECK(probe >= 0);
    struct pollfd wait = {.fd = probe, .events = POLLIN};
    strcpy(message.name, "model");
    CHECK_EQUAL(ddx_send(probe, &message, NULL, NULL, 0), 0);
    CHECK_EQUAL(poll(&wait, 1, 10000), 1);
    CHECK_EQUAL(ddx_receive(probe, &packet), 1);
    struct ddx_layout *layout = ddx_layout_copy(ddx_packet_layout(&packet));
    close(probe);
    ddx_store_done_item(model);

    wait.fd = probe = ddx_connect(DDX_STORE_PORT);
    strcpy(message.name, "item");
    CHECK_EQUAL(ddx_send(probe, &message, NULL, NULL, 0), 0);
    message.operation = DDX_CLAIM;
    CHECK_EQUAL(ddx_send(probe, &message, layout, NULL, 0), 0);
    do {
        CHECK_EQUAL(poll(&wait, 1, 10000), 1);
        CHECK_EQUAL(ddx_receive(probe, &packet), 1);
        ddx_packet_close(&packet);
    } while (packet.message.operation != DDX_CLAIMED);
    uint64_t meanwhile = all().reserved;
    close(probe);
    DDX_STORE_ITEM *item = create("item", 800000, 400000);
    CHECK(item);
    uint64_t then = all().reserved;
    printf("%" PRIu64 " bytes while it gets ready, then %" PRIu64 "\n", meanwhile, then);
    CHECK(meanwhile >= then);
    free(layout);
    end();
}

/* The next store has less memory: an item without room waits for it, and its frames continue. */
static void test_less_than_before(void) {
    const struct timespec step = {0, 5000000};
    struct ddx_frame frame;
    struct ddx_item_info info;
    void *data;

    begin("8M");
    DDX_STORE_ITEM *out = create("large", 800000, 0), *in = ddx_store_lookup_item(id, "large", NULL, 0);
    CHECK(out && in);
    CHECK_EQUAL(ddx_store_loan(out, &data), 0);
    CHECK_EQUAL(ddx_store_publish(out, NULL), 0);
    CHECK_EQUAL(ddx_store_acquire(in, &frame, 0, DDX_CURRENT), 0);
    store_stop(SIGKILL);
    store_start("1M");
    int64_t limit = ddx_time_now() + 10000000000;
    while (!create("small", 4096, 0)) { /* once it exists, all holders have reported */
        CHECK(errno == ECONNREFUSED && ddx_time_now() < limit);
        nanosleep(&step, NULL);
    }
    CHECK(all().reserved <= all().budget);
    CHECK_EQUAL(ddx_store_release(in), 0);
    for (unsigned i = 2; i < 10; i++) {
        CHECK_EQUAL(ddx_store_loan(out, &data), 0);
        CHECK_EQUAL(ddx_store_publish(out, NULL), 0);
        CHECK_EQUAL(ddx_store_acquire(in, &frame, 0, DDX_NEXT), 0);
        CHECK_EQUAL(frame.sequence, i);
        CHECK_EQUAL(ddx_store_release(in), 0);
    }
    store_stop(SIGKILL);
    store_start("8M");
    limit = ddx_time_now() + 10000000000;
    while (ddx_store_item_info(in, &info) || info.writer_pid != getpid()) {
        CHECK(ddx_time_now() < limit);
        nanosleep(&step, NULL);
    }
    CHECK_EQUAL(info.sequence, 9);
    end();
}

int main(void) {
    static void (*const tests[])(void) = {test_one_program, test_too_much, test_getting_ready, test_pages,
                                          test_less_than_before};

    store_folder_make();
    for (unsigned i = 0; i < sizeof tests / sizeof *tests; i++)
        tests[i]();
    return 0;
}
