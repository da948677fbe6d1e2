/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Store and writers die in such an order that somebody comes back with an epoch that has ended long ago. The newest one
 * counts, and numbers never go back.
 */
#include <errno.h>

#include "puppet.h"
#include "tests.h"

static struct ddx_item_info info;

static bool writer_is(const struct puppet *puppet) {
    return told_of(&info) && info.writer_pid == (puppet ? puppet->pid : 0);
}

/*
 * A stopped writer is replaced after a restart, and its successor dies. It must not go on where it was. A reader that
 * was stopped all the time reports first to the next store.
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
    AWAIT(puppet_ask(next, ORDER_WRITE, 50) == 55, "nobody takes the stopped writer's place");
    ASK(reader, HOLD, 1, 55);
    puppet_kill(next);
    AWAIT(writer_is(NULL), "the store does not notice");
    puppet_go_on(writer);
    AWAIT(puppet_ask(writer, ORDER_WRITE, 1) == -EEXIST, "the former writer is not told");
    if (!told_of(&info) || info.sequence != 55 || info.epoch != 2)
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
    if (!told_of(&info) || info.sequence != 55 || info.epoch != 2)
        fail("epoch %u ends with %llu", info.epoch, (unsigned long long)info.sequence);
    ASK(sleeper, LOOK, 0, 5);
    AWAIT(puppet_ask(sleeper, ORDER_HOLD, 0) == 55, "the reader of the first epoch does not follow");
    next = puppet_begin(NULL);
    ASK(next, WRITE, 1, 56);
    ASK(reader, LOOK, 0, 55);
    puppets_end();
}

/* The newest frame lies in a slot that no reader was told of, and who knew of it dies: the one before it is left. */
static void nobody_was_told(void) {
    store_begin("store.ready:5:stop"); /* control page, two slots, one for each of two readers */
    struct puppet *writer = puppet_begin(NULL), *reader[2] = {puppet_begin(NULL), puppet_begin(NULL)};
    struct puppet *next = puppet_begin(NULL), *guest = puppet_begin(NULL);
    uint32_t struck = stage->journal.struck;
    ASK(writer, WRITE, 1, 1);
    ASK(reader[0], HOLD, 0, 1);
    ASK(writer, WRITE, 1, 2);
    ASK(reader[1], HOLD, 0, 2);
    AWAIT(stage->journal.struck > struck, "no slot is added");
    ASK(writer, WRITE, 2, 4);
    puppet_kill(writer);
    store_kill();
    store_begin(NULL);
    AWAIT(puppet_ask(next, ORDER_LOOKUP, 0) == 0, "the store does not come back");
    int64_t number = 0;
    AWAIT((number = puppet_ask(next, ORDER_WRITE, 0)) >= 0, "nobody takes the dead writer's place");
    int64_t left = puppet_ask(guest, ORDER_HOLD, 1);
    if (left < 2)
        fail("the newest frame that is left is %lld", (long long)left);
    AWAIT((number = puppet_ask(next, ORDER_WRITE, 1)) > 0, "nobody takes the dead writer's place");
    if (number < 4)
        fail("after 4 frames the next one has number %lld", (long long)number);
    ASK(reader[0], LOOK, 0, 1);
    ASK(reader[1], LOOK, 0, 2);
    ASK(reader[1], HOLD, 1, number);
    puppets_end();
}

int test_epochs(void) {
    old_ones_come_back();
    nobody_was_told();
    return 0;
}
