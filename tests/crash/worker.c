/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The store's worker dies repeatedly, hangs, or is killed by a client's request: no program loses its connection, a
 * reader in order gets every frame, and a new program is admitted.
 */
#include <string.h>

#include "puppet.h"
#include "tests.h"

#define DEATHS 200
#define PERIOD 0.015      /* the reader keeps 64 frames, 0.96 s, in which a busy machine must run it */
#define HANGS 30000000000 /* ns: the holder waits for five of its own seconds */

static uint64_t lost(void) {
    return stage->journal.passed[DDX_AT_KEEPER_LOST];
}

/* Frames continue, and other programs come and go. */
static void dies_again_and_again(void) {
    store_begin(NULL);
    struct party *writer = party_begin('w', 0, PERIOD, NULL);
    struct party *reader = party_begin('k', 0, 0, NULL);
    await_frames(0, 20, 1, "at first");
    uint64_t before = lost(), guests = 0;
    struct party *guest = NULL;
    for (unsigned i = 0; i < DEATHS; i++) {
        if (!guest)
            guest = party_begin("nom"[i % 3], 0, 0, NULL);
        uint64_t begun = stage->journal.passed[DDX_AT_STORE_LISTENS];
        store_kill_worker();
        AWAIT(stage->journal.passed[DDX_AT_STORE_LISTENS] > begun, "no other worker");
        nap((i % 7) / 1000.0);
        if (i % 10 == 0)
            await_frames(0, 1, 1, "after a worker's death");
        if (actor_of(guest)->frames > 3) {
            party_end(guest, SIGTERM);
            guest = NULL;
            guests++;
        }
    }
    if (guest)
        party_end(guest, SIGKILL);
    party_end(reader, SIGTERM);
    look();
    const struct actor *a = actor_of(reader);
    if (a->missed || a->frames != a->last - a->first + 1)
        fail("the reader got %llu frames, and missed %llu", (unsigned long long)a->frames,
             (unsigned long long)a->missed);
    if (lost() != before)
        fail("%llu connections were lost", (unsigned long long)(lost() - before));
    printf("%u workers died, %llu frames were read, and %llu guests\n", DEATHS, (unsigned long long)a->frames,
           (unsigned long long)guests);
    party_end(writer, SIGKILL);
    store_kill();
    memset(&stage->stream[0], 0, sizeof stage->stream[0]);
    stage->stream[0].allowed = ~0u;
}

/* The worker hangs without dying. */
static void hangs(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    ASK(reader, HOLD, 0, 1);
    uint64_t before = lost();
    pid_t worker = store_worker();
    int64_t since = ddx_time_now();
    kill(worker, SIGSTOP);
    while (store_worker() == worker || !store_worker()) {
        if (ddx_time_now() > since + HANGS)
            fail("hang: no program takes the worker's place");
        kill(store_process, SIGUSR1); /* a program that keeps asking for the store's counters makes no difference */
        nap(0.01);
    }
    printf("another worker after %.1f s\n", (double)(ddx_time_now() - since) / 1e9);
    struct puppet *guest = puppet_begin(NULL);
    ASK(guest, HOLD, 0, 1);
    ASK(writer, WRITE, 10, 11);
    ASK(reader, LOOK, 0, 1);
    ASK(guest, HOLD, 0, 11);
    if (lost() != before)
        fail("a program lost its connection");
    puppets_end();
}

/* A request that kills each worker: its sender is no longer served, the other programs are. */
static void poison(void) {
    setenv("DDX_BROKEN", "one-kind-of-request-kills-the-store-s-worker", 1);
    store_begin(NULL);
    unsetenv("DDX_BROKEN");
    struct puppet *writer = puppet_begin(NULL), *reader = puppet_begin(NULL), *poisoner = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    ASK(reader, HOLD, 0, 1);
    ASK(poisoner, HOLD, 0, 1);
    uint64_t before = lost();
    if (puppet_ask(poisoner, ORDER_INFO, 0) == 0)
        fail("there is no poison in it");
    ASK(writer, WRITE, 10, 11);
    ASK(reader, LOOK, 0, 1);
    ASK(reader, HOLD, 0, 11);
    if (lost() > before + 1)
        fail("others lost their connections");
    puppets_end();
}

int test_worker(void) {
    dies_again_and_again();
    hangs();
    poison();
    return 0;
}
