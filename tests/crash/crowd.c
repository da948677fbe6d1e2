/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * An item with more frames than a socket holds messages: a program that is slow to read all of them, or stopped, keeps
 * its connection, and no other program waits for it.
 */
#include "puppet.h"
#include "tests.h"

#define KEEPERS 4
#define KEEP 60 /* frames; all readers together need more than the 165 messages that a socket holds */

static struct ddx_item_info info;

static bool readers_are(unsigned count) {
    return read_info(&info) && info.readers == count;
}

static void begin_keepers(struct puppet **keeper, int64_t sequence) {
    for (unsigned i = 0; i < KEEPERS; i++) {
        keeper[i] = puppet_begin(NULL);
        ASK(keeper[i], KEEP, KEEP, 0);
        ASK(keeper[i], HOLD, 0, sequence);
    }
}

/* Number of handles that the store considers closed. */
static uint64_t lost(void) {
    return stage->journal.passed[DDX_AT_STORE_GONE];
}

/* A stopped reader, while all those frames are added; the next writer; new readers; another store. */
static void all_messages_arrive(void) {
    struct puppet *keeper[KEEPERS];

    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *next = puppet_begin(NULL), *stopped = puppet_begin(NULL);
    uint64_t before = lost();
    ASK(writer, WRITE, 1, 1);
    ASK(stopped, HOLD, 0, 1);
    puppet_stop(stopped);
    begin_keepers(keeper, 1);
    ASK(writer, WRITE, 300, 301);
    puppet_kill(writer);
    AWAIT(read_info(&info) && !info.writer_pid, "the store does not notice");
    ASK(next, WRITE, 300, 601);
    puppet_go_on(stopped);
    ASK(stopped, LOOK, 0, 1);
    AWAIT(puppet_ask(stopped, ORDER_HOLD, 1) == 601, "the stopped reader does not follow");
    struct puppet *guest = puppet_begin(NULL);
    ASK(guest, HOLD, 0, 601);
    if (lost() != before + 1)
        fail("%llu connections were lost, not the dead writer's alone", (unsigned long long)(lost() - before));
    uint64_t accepted = stage->journal.passed[DDX_AT_KEEPER_ACCEPTED];
    store_kill();
    store_begin(NULL);
    AWAIT(readers_are(KEEPERS + 2) && info.writer_pid, "a program does not come back");
    AWAIT(stage->journal.passed[DDX_AT_KEEPER_ACCEPTED] >= accepted + KEEPERS + 3, "a program does not hear of all");
    if (lost() != before + 1)
        fail("%llu connections were lost after the restart", (unsigned long long)(lost() - before - 1));
    ASK(next, WRITE, 300, 901);
    for (unsigned i = 0; i < KEEPERS; i++)
        ASK(keeper[i], LOOK, 0, 1);
    ASK(guest, LOOK, 0, 601);
    puppets_end();
}

/* The next store does not listen yet: no program waits for it while its handle is locked. */
static void store_does_not_listen(void) {
    struct puppet *keeper[KEEPERS];

    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    begin_keepers(keeper, 1);
    ASK(writer, WRITE, 1, 2);
    store_kill();
    uint64_t slots = stage->journal.passed[DDX_AT_KEEPER_SLOT], struck = stage->journal.struck;
    store_begin("store.listens:1:stop");
    AWAIT(stage->journal.struck > struck, "the store does not begin");
    AWAIT(stage->journal.passed[DDX_AT_KEEPER_SLOT] >= slots + 150 * (KEEPERS + 1), "no program finds the store");
    int64_t free = puppet_ask(writer, ORDER_FREE, 50);
    if (free < 25)
        fail("the writer's handle was free %lld times of 50", (long long)free);
    ASK(writer, WRITE, 300, 302);
    store_go_on();
    AWAIT(readers_are(KEEPERS) && info.writer_pid, "a program does not come back");
    ASK(writer, WRITE, 300, 602);
    for (unsigned i = 0; i < KEEPERS; i++)
        ASK(keeper[i], LOOK, 0, 1);
    puppets_end();
}

int test_crowd(void) {
    all_messages_arrive();
    store_does_not_listen();
    return 0;
}
