/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * While the store restarts, a stopped reader holds a frame and cannot report. The frame must not change, whatever other
 * programs do; a party that finds a change complains. And when a store dies in the middle of a message, either all
 * receivers know it or none.
 */
#include <string.h>

#include "director.h"
#include "tests.h"

#define PERIOD 0.001
#define ROUND 60 /* frames after which the writer has used all slots */

static void restart_store(void) {
    store_kill();
    store_begin(NULL);
}

/* Ends all, including the items, so that numbers begin at 1 again. */
static void end_all(void) {
    for (unsigned i = 0; i < ACTORS; i++)
        if (party[i].pid)
            party_end(&party[i], SIGKILL);
    look();
    store_kill();
    for (unsigned i = 0; i < STREAMS; i++) {
        memset(&stage->stream[i], 0, sizeof stage->stream[i]);
        stage->stream[i].allowed = ~0u;
    }
}

/* The new store numbers readers again: another reader gets the holder's former number, and dies. */
static void same_number(void) {
    struct party *others[3];

    store_begin(NULL);
    struct party *holder = party_begin('n', 0, 0, "reader.holds:5:stop");
    AWAIT(actor_of(holder)->beats > 0, "the first reader does not begin"); /* it is admitted: number 1 */
    uint32_t struck = stage->journal.struck;
    struct party *writer = party_begin('w', 0, PERIOD, NULL);
    for (unsigned i = 0; i < 3; i++)
        others[i] = party_begin('n', 0, 0, NULL);
    AWAIT(stage->journal.struck != struck, "the first reader holds no frame");
    holder->stopped = true;
    await_frames(0, 10, 1, "before the restart");
    uint64_t back = stage->journal.passed[DDX_AT_STORE_READER_BACK];
    party_stop(writer); /* it is also a reader, which must come back after the others */
    restart_store();
    AWAIT(stage->journal.passed[DDX_AT_STORE_READER_BACK] >= back + 3, "readers do not come back");
    party_go_on(writer);
    AWAIT(stage->journal.passed[DDX_AT_STORE_READER_BACK] >= back + 4, "the writer does not come back");
    uint64_t gone = stage->journal.passed[DDX_AT_CLAIM_READER_GONE];
    for (unsigned i = 0; i < 3; i++)
        party_end(others[i], SIGKILL);
    AWAIT(stage->journal.passed[DDX_AT_CLAIM_READER_GONE] >= gone + 3, "the writer does not hear of the deaths");
    uint64_t done = stage->stream[0].done;
    AWAIT(stage->stream[0].done >= done + ROUND, "the writer does not write on");
    party_go_on(holder);
    await_frames(0, 20, 1, "the stopped reader goes on");
    end_all();
}

/*
 * A writer has not reported for long, so another one is admitted, which is slow. A new reader must not get the former
 * writer's frames: that writer does not know the reader, and continues.
 */
static void between_two_writers(void) {
    store_begin(NULL);
    struct party *former = party_begin('w', 1, PERIOD, "keeper.heard:1:slow");
    party_begin('n', 1, 0, NULL);
    await_frames(1, 10, 1, "at first");
    uint64_t claims = stage->journal.passed[DDX_AT_CLAIM_SENT];
    struct party *next = party_begin('w', 1, PERIOD, "claim.control:1:stop");
    AWAIT(stage->journal.passed[DDX_AT_CLAIM_SENT] > claims, "no program stands by");
    uint32_t struck = stage->journal.struck;
    party_stop(former);
    uint64_t settled = stage->journal.passed[DDX_AT_STORE_SETTLED];
    restart_store();
    AWAIT(stage->journal.passed[DDX_AT_STORE_SETTLED] > settled, "the store does not settle");
    AWAIT(stage->journal.struck == struck + 1, "no program is let in instead of the stopped writer");
    next->stopped = true;
    struct party *guest = party_begin('n', 1, 0, "reader.holds:1:stop");
    guest->stopped = true;
    nap(0.3); /* a wrong delivery would take a hundredth of that */
    party_go_on(former);
    nap(0.1);
    party_go_on(guest); /* it might have got a frame */
    nap(0.1);
    look();
    party_end(next, SIGKILL);
    party_end(former, SIGKILL);
    party_begin('w', 1, PERIOD, NULL);
    AWAIT(stage->journal.struck == struck + 2, "the newcomer gets no frame");
    party_go_on(guest);
    await_frames(1, 20, 2, "the next writer");
    end_all();
}

/*
 * The store dies when the first reader has received the next epoch, but none of its slots. That reader reports first to
 * the next store, and must still have the epoch with the last frame.
 */
static void half_told(void) {
    struct party *others[2];

    store_begin("store.epoch_begun:5:die");
    struct party *writer = party_begin('w', 0, PERIOD, NULL); /* a reader, too: notified when it begins to write, ... */
    AWAIT(stage->stream[0].terms == 1, "no program writes");
    for (unsigned i = 0; i < 2; i++) { /* ... and these, ... */
        others[i] = party_begin('n', 0, 0, NULL);
        AWAIT(actor_of(others[i])->frames > 3, "a reader gets no frames");
    }
    struct party *next = party_begin('w', 0, PERIOD, NULL); /* ... and this one, twice: last in, first notified */
    AWAIT(actor_of(next)->beats > 2, "no program stands by");
    for (unsigned i = 0; i < 2; i++)
        party_stop(others[i]);
    party_end(writer, SIGKILL);
    store_ended();
    uint64_t back = stage->journal.passed[DDX_AT_STORE_READER_BACK];
    store_begin(NULL);
    AWAIT(stage->journal.passed[DDX_AT_STORE_READER_BACK] > back, "no program reports");
    for (unsigned i = 0; i < 2; i++)
        party_go_on(others[i]);
    await_takeover(0, 2, "the next writer goes on from the last frame");
    end_all();
}

int test_restart(void) {
    same_number();
    between_two_writers();
    half_told();
    return 0;
}
