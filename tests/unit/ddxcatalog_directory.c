/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Records that no catalog sends: none is accepted, all are counted. The offset of another machine's clock. */
#include "check.h"
#include "directory.h"

#include <errno.h>

#define LONGEST 70000

static struct catalog catalog = {.identity = {.id = 7, .host = "laptop", .name = "laptop"}};

static char none[] = "", robot[] = "robot";

static struct network_record machine_of(uint64_t id, char *name) {
    return (struct network_record){.machine = id,
                                   .item = none,
                                   .name = name,
                                   .host = name,
                                   .boot = none,
                                   .type = none,
                                   .declaration = none,
                                   .extents = none,
                                   .topic = none};
}

static struct network_record item_of(uint64_t id, char *item) {
    static char type[] = "GPS", declaration[] = "struct { double x; }", topic[] = "rt/robot/gps";
    struct network_record record = machine_of(id, robot);

    record.item = item;
    record.type = type;
    record.declaration = declaration;
    record.topic = topic;
    return record;
}

static void there(struct directory *directory, struct network_record record, unsigned refused) {
    uint64_t before = directory_refused(directory);

    directory_take(directory, &record, NETWORK_THERE);
    CHECK_EQUAL(directory_refused(directory) - before, refused);
}

static void test_names(struct directory *directory) {
    static const char *const bad[] = {"a/b", "a:b", "a b", "a\nb", "\x1b]0;x\x07", "\xff", "a\x7f"};
    const struct remote *remote;
    char item[DDX_NAME_MAX + 2];

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        strcpy(item, bad[i]);
        there(directory, item_of(1, item), 1);
        struct network_record record = machine_of(9, item);
        there(directory, record, 1);
    }
    memset(item, 'a', sizeof item);
    item[DDX_NAME_MAX + 1] = 0;
    there(directory, item_of(1, item), 1);
    item[DDX_NAME_MAX] = 0;
    there(directory, item_of(1, item), 0);
    CHECK_EQUAL(directory_find(directory, "robot:a/b", &remote), -ENOENT);
    CHECK_EQUAL(directory_machines(directory)->count, 1);
}

static void test_texts(struct directory *directory) {
    static const char *const bad[] = {"",
                                      "struct {",
                                      "struct { double x[0]; }",
                                      "struct { void x; }",
                                      "double x;",
                                      "struct { double x[99999999999]; }",
                                      "struct { struct { int8_t x; } y[1000000]; }"};
    static char text[LONGEST + 1], gps[] = "gps", wrong[] = "y=1";
    struct network_record record;

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        record = item_of(1, gps);
        record.declaration = strcpy(text, bad[i]);
        there(directory, record, 1);
    }
    memset(text, ' ', LONGEST); /* valid, but too long */
    memcpy(text, "struct { double x; }", 20);
    record = item_of(1, gps);
    record.declaration = text;
    there(directory, record, 1);
    record = item_of(1, gps);
    record.type = text;
    there(directory, record, 1);
    record = item_of(1, gps);
    record.topic = text;
    there(directory, record, 1);
    record = item_of(1, gps);
    record.extents = wrong;
    there(directory, record, 1);
    record.topic = NULL;
    there(directory, record, 1);
    static const char *const topics[] = {"", "rt", "gps", "rt/gps\n", "rt/g ps", "rt/\xff", "dds/gps", "rt/g__ps"};
    for (size_t i = 0; i < sizeof topics / sizeof *topics; i++) {
        record = item_of(1, gps);
        record.topic = strcpy(text, topics[i]);
        there(directory, record, 1);
    }
}

static void test_too_many(struct directory *directory) {
    static char name[] = "machine0000";
    char item[16];

    for (unsigned i = 0; i < 10000; i++) { /* one more was accepted above */
        snprintf(item, sizeof item, "i%u", i);
        there(directory, item_of(1, item), i >= ITEMS_MAX - 1);
    }
    for (unsigned i = 0; i < 1000; i++) {
        snprintf(name, sizeof name, "machine%u", i);
        there(directory, machine_of(100 + i, name), i >= NETWORK_MACHINES - 1);
    }
    CHECK_EQUAL(directory_machines(directory)->count, NETWORK_MACHINES);
    CHECK_EQUAL(machines_find(directory_machines(directory), 1)->items, ITEMS_MAX);
}

/* Eight levels of structs with long names: 65,536 leaves, each with a name of 500 bytes, from 650 bytes of text. */
static void nest(char *text) {
    char inner[LONGEST], name[64];

    memset(name, 'n', 63);
    name[63] = 0;
    sprintf(text, "int8_t %s; ", name);
    for (unsigned i = 0; i < 6; i++) {
        strcpy(inner, text);
        sprintf(text, "struct { %s} %s; ", inner, name);
    }
    strcpy(inner, text);
    sprintf(text, "struct { struct { %s} %s[65536]; }", inner, name);
}

/* The texts of a machine, of all machines, and a type that would need too much memory when it is wanted. */
static void test_bytes(struct directory *directory) {
    static char text[LONGEST], gps[] = "gps", name[] = "machine0000";
    struct network_record record = item_of(1, gps);
    char item[16];
    unsigned known = 0;

    there(directory, machine_of(1, robot), 0);
    nest(text);
    record.declaration = text;
    there(directory, record, 1);
    record.declaration = strcpy(text, "struct { struct { float x; float y; float z; float i; } point[16384]; }");
    there(directory, record, 0); /* as many leaves, with short names */
    uint64_t before = directory_refused(directory);
    memset(text, ' ', NETWORK_TEXT - 1);
    memcpy(text, "struct { double x; }", 20);
    text[NETWORK_TEXT - 1] = 0;
    for (unsigned machine = 20; machine < 36; machine++) {
        snprintf(name, sizeof name, "machine%u", machine);
        there(directory, machine_of(machine, name), 0);
        for (unsigned i = 0; i < 100; i++) {
            snprintf(item, sizeof item, "i%u", i);
            record = item_of(machine, item);
            record.declaration = text;
            directory_take(directory, &record, NETWORK_THERE);
        }
        unsigned items = machines_find(directory_machines(directory), machine)->items;
        CHECK(items * NETWORK_TEXT <= 1 << 20);
        known += items;
    }
    CHECK(known * NETWORK_TEXT <= 8 << 20 && known * NETWORK_TEXT > 7 << 20);
    CHECK_EQUAL(directory_refused(directory) - before, 1600 - known);
    record = machine_of(20, robot); /* its room is free again */
    directory_take(directory, &record, NETWORK_GONE);
    record = item_of(35, gps);
    record.declaration = text;
    there(directory, record, 0);
}

/* This machine's own records, records of an unknown machine, and changes of unknown items. */
static void test_forged_ids(struct directory *directory) {
    static char gps[] = "gps";
    struct network_record record = item_of(3, gps);

    there(directory, record, 1);
    there(directory, machine_of(7, robot), 1);
    there(directory, item_of(7, gps), 1);
    record.item = NULL;
    there(directory, record, 1);
    record = item_of(3, gps);
    directory_take(directory, &record, NETWORK_GONE);
    directory_take(directory, &record, NETWORK_AWAY);
    record = machine_of(3, robot);
    directory_take(directory, &record, NETWORK_GONE);
    record = machine_of(7, robot);
    directory_take(directory, &record, NETWORK_GONE);
    CHECK_EQUAL(directory_machines(directory)->count, 1);
}

/* The other clock is 5000 s ahead; a delay in one direction only is an error of half of it, within the bound. */
static void test_the_offset_of_a_clock(void) {
    const int64_t ms = 1000000, s = 1000 * ms, ahead = 5000 * s;
    struct offset offset = {.count = 0};
    int64_t apart, bound;

    CHECK(!offset_get(&offset, s, &apart, &bound));
    CHECK(offset_add(&offset, s, s + ahead + 9 * ms, s + ahead + 10 * ms, s + 11 * ms));
    CHECK(offset_get(&offset, s + 11 * ms, &apart, &bound));
    CHECK_EQUAL(apart, ahead + 4 * ms);
    CHECK_EQUAL(bound, 5 * ms + ms / 10000);
    CHECK(offset_add(&offset, 2 * s, 2 * s + ahead + ms, 2 * s + ahead + ms, 2 * s + 2 * ms));
    CHECK(offset_get(&offset, 3 * s + 2 * ms, &apart, &bound));
    CHECK_EQUAL(apart, ahead);
    CHECK_EQUAL(bound, ms + s / 10000);
    for (int i = 0; i < OFFSET_SAMPLES; i++) /* until the best sample is too old */
        CHECK(offset_add(&offset, 4 * s, 4 * s - ahead + ahead + 2 * ms, 4 * s + 2 * ms, 4 * s + 4 * ms));
    CHECK(offset_get(&offset, 5 * s, &apart, &bound));
    CHECK_EQUAL(apart, 0);
    CHECK(!offset_add(&offset, s, s, s, s - 1));           /* received before it was sent */
    CHECK(!offset_add(&offset, s, s, s + 2 * ms, s + ms)); /* longer at the other machine than the round trip */
    CHECK(!offset_add(&offset, INT64_MIN, s, s, s));
    CHECK(!offset_add(&offset, s, s, INT64_MAX, s));
}

int main(void) {
    struct directory *directory = directory_open(&catalog);

    there(directory, machine_of(1, robot), 0);
    test_forged_ids(directory);
    test_names(directory);
    test_texts(directory);
    test_too_many(directory);
    directory_close(directory);
    directory = directory_open(&catalog);
    test_bytes(directory);
    directory_close(directory);
    test_the_offset_of_a_clock();
    return 0;
}
