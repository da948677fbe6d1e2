/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Store and writers die in an order in which a program comes back with an epoch that ended long ago. The newest epoch
 * counts, and numbers never go back.
 */
#include <errno.h>

#include "puppet.h"
#include "tests.h"

static struct ddx_item_info info;

static bool writer_is(const struct puppet *puppet) {
    return read_info(&info) && info.writer_pid == (puppet ? puppet->pid : 0);
}

/*
 * A stopped writer is replaced after a restart, and its successor dies. The writer must not continue in its epoch. A
 * reader that was stopped during all of this reports first to the next store.
 */
static void old_ones_come_back(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *next = puppet_begin(NULL);
    struct puppet *sleeper = puppet_begin(NULL), *reader = puppet_begin(NULL);
    ASK(writer, WRITE, 5, 5);
    ASK(sleeper, HOLD, 0, 5);
    ASK(reader, HOLD, 0, 5);
    puppet_stop(writer);
    puppet_stop(sleeper);
    store_kill();
    store_begin(NULL);
    AWAIT(puppet_ask(next, ORDER_WRITE, 50) == 55, "no program takes the stopped writer's place");
    ASK(reader, HOLD, 1, 55);
    puppet_kill(next);
    AWAIT(writer_is(NULL), "the store does not notice");
    puppet_go_on(writer);
    AWAIT(puppet_ask(writer, ORDER_WRITE, 1) == -EEXIST, "the former writer is not told");
    if (!read_info(&info) || info.sequence != 55 || info.epoch != 2)
        fail("epoch %u ends with %llu", info.epoch, (unsigned long long)info.sequence);
    puppet_kill(writer);

    puppet_stop(reader);
    store_kill();
    store_begin(NULL);
    uint64_t back = stage->journal.passed[DDX_AT_STORE_READER_BACK];
    puppet_go_on(sleeper);
    AWAIT(stage->journal.passed[DDX_AT_STORE_READER_BACK] > back, "the reader of the first epoch does not come back");
    puppet_go_on(reader);
    AWAIT(stage->journal.passed[DDX_AT_STORE_READER_BACK] > back + 1, "the reader of the second does not come back");
    if (!read_info(&info) || info.sequence != 55 || info.epoch != 2)
        fail("epoch %u ends with %llu", info.epoch, (unsigned long long)info.sequence);
    ASK(sleeper, LOOK, 0, 5);
    AWAIT(puppet_ask(sleeper, ORDER_HOLD, 0) == 55, "the reader of the first epoch does not follow");
    next = puppet_begin(NULL);
    ASK(next, WRITE, 1, 56);
    ASK(reader, LOOK, 0, 55);
    puppets_end();
}

/*
 * A slot was added that no reader knows, and the programs that know the slot die: the newest frame is not in it. The
 * reader that had asked for that slot is not admitted yet.
 */
static void slot_is_unknown(void) {
    store_begin("store.ready:5:stop"); /* control page, two slots, one for each of two readers */
    struct puppet *writer = puppet_begin(NULL), *reader[2] = {puppet_begin(NULL), puppet_begin(NULL)};
    struct puppet *next = puppet_begin(NULL), *guest = puppet_begin(NULL);
    uint32_t struck = stage->journal.struck;
    ASK(writer, WRITE, 1, 1);
    ASK(reader[0], HOLD, 0, 1);
    ASK(writer, WRITE, 1, 2);
    puppet_say(reader[1], ORDER_HOLD, 0);
    AWAIT(stage->journal.struck > struck, "no slot is added");
    ASK(writer, WRITE, 2, 4);
    puppet_kill(writer);
    store_kill();
    store_begin(NULL);
    AWAIT(puppet_ask(next, ORDER_LOOKUP, 0) == 0, "the store does not come back");
    int64_t number = 0;
    AWAIT((number = puppet_ask(next, ORDER_WRITE, 0)) >= 0, "no program takes the dead writer's place");
    int64_t left = puppet_ask(guest, ORDER_HOLD, 1);
    if (left != 4)
        fail("the newest frame that is left is %lld", (long long)left);
    AWAIT((number = puppet_ask(next, ORDER_WRITE, 1)) > 0, "no program takes the dead writer's place");
    if (number < 4)
        fail("after 4 frames the next one has number %lld", (long long)number);
    ASK(reader[0], LOOK, 0, 1);
    if (puppet_hear(reader[1]) == 0)
        fail("a frame without a number");
    ASK(reader[1], HOLD, 1, number);
    puppets_end();
}

/* The stopped writer of the first epoch reports before the second one's: it must give up nevertheless. */
static void old_writer_first(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *next = puppet_begin(NULL), *reader = puppet_begin(NULL);
    ASK(writer, WRITE, 5, 5);
    ASK(reader, HOLD, 0, 5);
    puppet_stop(writer);
    store_kill();
    store_begin(NULL);
    AWAIT(puppet_ask(next, ORDER_WRITE, 50) == 55, "no program takes the stopped writer's place");
    ASK(reader, HOLD, 1, 55);
    puppet_stop(next);
    puppet_stop(reader);
    store_kill();
    store_begin(NULL);
    puppet_go_on(writer);
    AWAIT(writer_is(writer), "the first writer does not come back");
    puppet_go_on(next);
    puppet_go_on(reader);
    AWAIT(writer_is(next), "the second writer does not come back");
    ASK(next, WRITE, 1, 56);
    ASK(reader, HOLD, 1, 56);
    AWAIT(puppet_ask(writer, ORDER_WRITE, 1) == -EEXIST, "the first writer is not told");
    ASK(next, WRITE, 1, 57);
    ASK(reader, HOLD, 1, 57);
    puppets_end();
}

static bool readers_are(unsigned count) {
    return read_info(&info) && info.readers == count;
}

/*
 * Readers have attached while one was stopped, so that a slot is missing after another restart. The slot is added when
 * the writer comes back, and the store dies before it has told the readers: the writer does not use that slot yet.
 */
static void slot_is_added_late(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader[3], *next = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    for (unsigned i = 0; i < 3; i++)
        reader[i] = puppet_begin(NULL);
    for (unsigned i = 0; i < 2; i++) {
        ASK(reader[i], HOLD, 0, 1);
        ASK(reader[i], RELEASE, 0, 0);
    }
    puppet_stop(reader[1]);
    store_kill();
    store_begin(NULL);
    AWAIT(writer_is(writer) && info.readers == 1, "no program comes back");
    ASK(reader[2], HOLD, 0, 1);
    ASK(reader[2], RELEASE, 0, 0);
    ASK(writer, WRITE, 8, 9);
    puppet_stop(writer);
    store_kill();
    uint64_t accepted = stage->journal.passed[DDX_AT_KEEPER_ACCEPTED];
    uint32_t struck = stage->journal.struck;
    store_begin("store.accepted:4:stop"); /* three readers, the writer */
    puppet_go_on(reader[1]);
    AWAIT(stage->journal.passed[DDX_AT_KEEPER_ACCEPTED] >= accepted + 3, "the readers do not come back");
    puppet_go_on(writer);
    AWAIT(stage->journal.struck > struck, "the writer does not come back");
    AWAIT(stage->journal.passed[DDX_AT_KEEPER_ACCEPTED] >= accepted + 4, "the writer is not told");
    ASK(writer, WRITE, 1, 10);
    puppet_kill(writer);
    store_kill();
    store_begin(NULL);
    AWAIT(readers_are(3), "the readers do not come back again");
    AWAIT(puppet_ask(next, ORDER_WRITE, 0) == 0, "no program takes the dead writer's place");
    ASK(reader[0], HOLD, 1, 10);
    ASK(next, WRITE, 1, 11);
    ASK(reader[0], HOLD, 1, 11);
    puppets_end();
}

/*
 * A writer skips numbers, and leaves. Its successors begin at 1 if too few are left; a reader in order gets each frame.
 */
static void numbers_jump(void) {
    static const int64_t number[] = {1 << 22, 1 << 23, 1 << 30, INT64_C(1) << 31, INT64_C(1) << 32, INT64_MAX, -2};

    store_begin(NULL);
    struct puppet *reader = puppet_begin(NULL), *honest = puppet_begin(NULL);
    ASK(honest, WRITE, 1, 1);
    ASK(reader, HOLD, 0, 1);
    for (unsigned i = 0; i < sizeof number / sizeof *number; i++) {
        struct puppet *jumper = puppet_begin(NULL);

        puppet_kill(honest);
        AWAIT(puppet_ask(jumper, ORDER_WRITE, 0) == 0, "no program takes the dead writer's place");
        ASK(jumper, JUMP, number[i], 0);
        ASK(jumper, WRITE, 1, number[i]);
        ASK(reader, NEXT, 1, number[i]);
        puppet_kill(jumper);
        honest = puppet_begin(NULL);
        AWAIT(puppet_ask(honest, ORDER_WRITE, 0) == 0, "no program takes the jumper's place");
        for (int64_t k = 1; k < 5; k++) {
            int64_t wanted = number[i] < INT64_C(1) << 62 && number[i] > 0 ? number[i] + k : k;

            ASK(honest, WRITE, 1, wanted);
            ASK(reader, NEXT, 1, wanted);
        }
    }
    puppets_end();
}

/* The writer dies before a reader in order has seen its last frames: the reader gets these, then the next writer's. */
static void last_ones_are_read(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader = puppet_begin(NULL), *next = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    ASK(reader, KEEP, 8, 0);
    ASK(reader, NEXT, 0, -ETIMEDOUT); /* there is no further frame */
    AWAIT(puppet_ask(writer, ORDER_READERS, 0) == 1, "no frames are kept");
    ASK(writer, WRITE, 8, 9);
    ASK(reader, NEXT, 0, 2);
    uint64_t slots = stage->journal.passed[DDX_AT_ATTACH_SLOT];
    puppet_kill(writer);
    AWAIT(puppet_ask(next, ORDER_WRITE, 1) == 10, "no program takes the dead writer's place");
    AWAIT(stage->journal.passed[DDX_AT_ATTACH_SLOT] >= slots + 10, "the reader hears of no other epoch");
    for (int64_t number = 3; number <= 10; number++)
        ASK(reader, NEXT, 1, number);
    ASK(next, WRITE, 1, 11);
    ASK(reader, NEXT, 1, 11);
    puppets_end();
}

int test_epochs(void) {
    last_ones_are_read();
    old_ones_come_back();
    old_writer_first();
    slot_is_added_late();
    numbers_jump();
    slot_is_unknown();
    return 0;
}
