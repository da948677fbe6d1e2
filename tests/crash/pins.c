/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A frame that a living program holds is never overwritten, even if store or writer know nothing of its reader. A
 * writer without a free slot drops its frame, and counts it.
 */
#include <errno.h>

#include "puppet.h"
#include "tests.h"

static bool readers_are(unsigned count) {
    struct ddx_item_info info;

    return read_info(&info) && info.readers == count;
}

static bool writer_is(const struct puppet *puppet) {
    struct ddx_item_info info;

    return read_info(&info) && info.writer_pid == puppet->pid;
}

static bool writer_is_gone(void) {
    struct ddx_item_info info;

    return read_info(&info) && !info.writer_pid;
}

/* The store has closed a stopped reader's connection, and takes the reader for dead. */
static void taken_for_dead(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    ASK(reader, HOLD, 0, 1);
    uint64_t told = stage->journal.passed[DDX_AT_STORE_READER_TOLD];
    puppet_say(reader, ORDER_HANG_UP, 0);
    puppet_await_stop(reader);
    AWAIT(stage->journal.passed[DDX_AT_STORE_READER_TOLD] > told, "the store does not notice");
    ASK(writer, WRITE, 100, 101);
    puppet_go_on(reader);
    puppet_hear(reader);
    ASK(reader, LOOK, 0, 1);
    AWAIT(readers_are(1), "the reader does not come back");
    ASK(writer, WRITE, 100, 201);
    ASK(reader, LOOK, 0, 1);
    ASK(reader, RELEASE, 0, 0);
    puppets_end();
}

/* A reader dies while its writer gets no messages. Its share goes to other readers in turn; none loses a frame. */
static void never_told(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *dead = puppet_begin(NULL), *reader[4];
    for (unsigned i = 0; i < 4; i++)
        reader[i] = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    ASK(reader[0], HOLD, 0, 1);
    ASK(writer, WRITE, 1, 2);
    ASK(dead, HOLD, 0, 2);
    puppet_say(writer, ORDER_HANG_UP, 0);
    puppet_await_stop(writer);
    puppet_kill(dead);
    AWAIT(readers_are(1), "the dead reader is still there");
    puppet_go_on(writer);
    puppet_hear(writer);
    AWAIT(writer_is(writer), "the writer does not come back");
    for (unsigned i = 1; i < 4; i++) {
        ASK(writer, WRITE, 1, i + 2);
        ASK(reader[i], HOLD, 0, i + 2);
    }
    ASK(writer, WRITE, 20, 25);
    ASK(reader[0], LOOK, 0, 1);
    for (unsigned i = 1; i < 4; i++)
        ASK(reader[i], LOOK, 0, i + 2);
    ASK(writer, SHORT, 0, 0);
    puppets_end();
}

/* After a restart the store does not know what a stopped reader holds, and gives the reader's share to another one. */
static void too_few(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader = puppet_begin(NULL), *stopped = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    ASK(reader, HOLD, 0, 1);
    ASK(writer, WRITE, 1, 2);
    ASK(stopped, HOLD, 0, 2);
    puppet_stop(stopped);
    store_kill();
    store_begin(NULL);
    AWAIT(readers_are(1) && writer_is(writer), "no program comes back");
    ASK(writer, WRITE, 1, 3);
    struct puppet *guest = puppet_begin(NULL);
    ASK(guest, HOLD, 0, 3);
    ASK(writer, WRITE, 1, 4); /* into the last free slot */
    for (unsigned i = 0; i < 3; i++)
        ASK(writer, WRITE, 1, -ENOBUFS);
    ASK(writer, SHORT, 0, 3);
    ASK(reader, LOOK, 0, 1);
    ASK(guest, LOOK, 0, 3);
    puppet_go_on(stopped);
    ASK(stopped, LOOK, 0, 2);
    AWAIT(readers_are(3), "the reader does not come back");
    ASK(stopped, RELEASE, 0, 0);
    ASK(writer, WRITE, 20, 24);
    ASK(reader, LOOK, 0, 1);
    ASK(guest, LOOK, 0, 3);
    puppets_end();
}

/*
 * The writer's program has no descriptor left for a new reader: that reader is refused, and no other program is
 * affected.
 */
static void no_descriptors(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader = puppet_begin(NULL), *second = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    ASK(reader, HOLD, 0, 1);
    AWAIT(puppet_ask(writer, ORDER_WRITE, 1) == 2, "the writer does not write");
    ASK(writer, LIMIT, 0, 0);
    ASK(second, HOLD, 0, -EBUSY); /* no descriptor for a slot */
    ASK(writer, WRITE, 8, 10);
    ASK(writer, LIMIT, 1, 0);
    ASK(second, HOLD, 0, -EBUSY); /* one for a slot, none for the pin page */
    ASK(writer, WRITE, 8, 18);
    ASK(reader, LOOK, 0, 1);
    ASK(writer, LIMIT, -1, 0);
    ASK(second, HOLD, 0, 18);
    ASK(writer, WRITE, 20, 38);
    ASK(reader, LOOK, 0, 1);
    ASK(second, LOOK, 0, 18);
    ASK(writer, SHORT, 0, 0);
    /* Nor does a writer begin that cannot map all pins. */
    struct puppet *next = puppet_begin(NULL);
    puppet_kill(writer);
    AWAIT(writer_is_gone(), "the store does not notice");
    for (int64_t room = 0; room < 7; room++) { /* control page, notice, four slots, two pin pages */
        ASK(next, LIMIT, room, 0);
        ASK(next, WRITE, 1, -EMFILE);
    }
    ASK(reader, LOOK, 0, 1);
    ASK(second, LOOK, 0, 18);
    ASK(next, LIMIT, -1, 0);
    ASK(next, WRITE, 20, 58);
    ASK(reader, LOOK, 0, 1);
    puppets_end();
}

/* The store has closed a stopped writer's connection: no other writer and no reader is admitted until it is back. */
static void writer_taken_for_dead(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *other = puppet_begin(NULL), *reader = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    puppet_say(writer, ORDER_HANG_UP, 0);
    puppet_await_stop(writer);
    AWAIT(writer_is_gone(), "the store does not notice");
    for (unsigned i = 0; i < 3; i++)
        ASK(other, WRITE, 1, -EEXIST);
    uint64_t asked = stage->journal.passed[DDX_AT_ATTACH_SENT];
    puppet_say(reader, ORDER_HOLD, 0);
    AWAIT(stage->journal.passed[DDX_AT_ATTACH_SENT] > asked + 2, "the reader does not ask");
    puppet_go_on(writer);
    puppet_hear(writer);
    if (puppet_hear(reader) != 1)
        fail("the reader is not let in");
    ASK(writer, WRITE, 20, 21);
    ASK(reader, LOOK, 0, 1);
    puppets_end();
}

/*
 * The writer has waited for the store in vain and hung up. A reader that attaches before the writer is back is not
 * admitted, because the writer would not check its pins.
 */
static void writer_is_away(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    store_stop();
    uint64_t asked = stage->journal.passed[DDX_AT_ATTACH_SENT];
    puppet_say(reader, ORDER_HOLD, 0);
    AWAIT(stage->journal.passed[DDX_AT_ATTACH_SENT] > asked, "the reader does not ask");
    ASK(writer, LEAVE, 0, 0);
    store_go_on();
    AWAIT(stage->journal.passed[DDX_AT_ATTACH_SENT] > asked + 1, "the reader does not ask again");
    ASK(writer, WRITE, 20, 21);
    int64_t got = puppet_hear(reader);
    if (got != 1 && got != 21)
        fail("the reader gets %lld", (long long)got);
    ASK(writer, WRITE, 20, 41);
    ASK(reader, LOOK, 0, got);
    puppets_end();
}

/* A program with a child dies: the child's inherited descriptors keep neither its writer nor its reader alive. */
static void child_lives_on(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader = puppet_begin(NULL), *next = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    ASK(reader, HOLD, 0, 1);
    pid_t child[2] = {(pid_t)puppet_ask(writer, ORDER_FORK, 0), (pid_t)puppet_ask(reader, ORDER_FORK, 0)};
    ASK(writer, WRITE, 20, 21); /* the parent continues as before */
    ASK(reader, LOOK, 0, 1);
    uint64_t gone = stage->journal.passed[DDX_AT_CLAIM_READER_GONE];
    puppet_kill(reader);
    AWAIT(stage->journal.passed[DDX_AT_CLAIM_READER_GONE] > gone, "the dead reader's pin stays");
    puppet_kill(writer);
    AWAIT(puppet_ask(next, ORDER_WRITE, 1) == 22, "no program may take the dead writer's place");
    for (unsigned i = 0; i < 2; i++)
        kill(child[i], SIGKILL);
    puppets_end();
}

int test_pins(void) {
    taken_for_dead();
    never_told();
    too_few();
    no_descriptors();
    writer_taken_for_dead();
    writer_is_away();
    child_lives_on();
    return 0;
}
