/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Walks through all points of fault.h: at each one a party is killed, and another is stopped, while writer, standby and
 * readers of two items continue. Each delivered frame is checked word by word (actor.c), losses are compared with the
 * writers' records, and a wait that does not end fails the test.
 */
#include <string.h>
#include <sys/wait.h>

#include "takeover.h"
#include "tests.h"

#define PERIOD 0.001
#define PATIENCE 120.0 /* seconds of stimuli until a point counts as never reached; races may take ten */
#define STOPPED 0.1    /* seconds that a stopped party is watched */

static struct party *victim;
static const char *at; /* the point's name */
static char where[64];
static int64_t worst_gap;
static struct takeover last_takeover, worst_takeover;
static unsigned takeovers;

static bool is(const char *name) {
    return !strcmp(at, name);
}

static bool in(const char *group) {
    return !strncmp(at, group, strlen(group));
}

static bool struck(unsigned before) {
    look();
    return stage->journal.struck != before;
}

static bool wait_struck(unsigned before, double seconds) {
    int64_t until = ddx_time_now() + (int64_t)(seconds * 1e9);

    while (!struck(before) && ddx_time_now() < until)
        nap(0.001);
    return struck(before);
}

/* A reader comes, gets three frames, and leaves. */
static void visit(char kind, unsigned before) {
    struct party *guest = party_begin(kind, 0, 0, NULL);

    for (int i = 0; i < 500 && !struck(before) && actor_of(guest)->frames < 3; i++)
        nap(0.001);
    party_end(guest, struck(before) ? SIGKILL : SIGTERM); /* it may be waiting for a stopped store */
}

static void change_writer(void) {
    struct party *owner = owner_of(0);

    if (owner && owner != victim) {
        party_end(owner, SIGKILL);
        party_begin('w', 0, PERIOD, NULL);
    }
}

/*
 * The store died while it added slots: the writer knows them, the victim does not. The victim is stopped until these
 * slots are written, and then the next store is stopped until the victim has looked.
 */
static void lose_slots(unsigned before) {
    uint32_t terms = stage->stream[0].terms;

    change_writer(); /* a new epoch has only as many slots as are needed */
    await_takeover(0, terms + 1, where);
    await_frames(0, 1, terms + 1, where);
    store_kill();
    store_begin("store.room_told:1:die");
    struct party *guest = party_begin('o', 0, 0, NULL);
    store_ended();
    party_end(guest, SIGKILL);
    party_stop(victim);
    uint64_t back = stage->journal.passed[DDX_AT_STORE_WRITER_BACK];
    store_begin(NULL);
    AWAIT(stage->journal.passed[DDX_AT_STORE_WRITER_BACK] >= back + STREAMS, "%s: writers do not come back", where);
    AWAIT(stage->journal.at[DDX_AT_STORE_ACCEPTED] > stage->journal.at[DDX_AT_STORE_WRITER_BACK],
          "%s: no writer is taken back", where);
    store_stop();
    party_go_on(victim);
    AWAIT(struck(before), "%s: never", where);
    store_go_on();
}

/* No frames until waiting readers give up. */
static void pause_writer(unsigned before) {
    struct party *owner = owner_of(0);

    if (!owner)
        return;
    kill(owner->pid, SIGSTOP);
    wait_struck(before, 1);
    kill(owner->pid, SIGCONT);
}

/* Stimuli for points that a party does not pass by itself. */
static void stimulate(unsigned turn, unsigned before) {
    if (is("claim.ended") || is("attach.ended"))
        kill(victim->pid, SIGTERM);
    else if (is("reader.unmapped"))
        lose_slots(before);
    else if (is("direct.restored"))
        pause_writer(before);
    else if (in("keeper.") && !is("keeper.heard")) {
        store_kill();
        store_begin(NULL);
    } else if (in("attach.") || in("store.")) {
        if (turn % 3 == 0)
            visit('m', before);
        else if (turn % 3 == 1)
            change_writer();
        else if (in("store."))
            visit('t', before);
    } else
        visit('o', before);
}

static void fault_text(char *text, size_t bytes, const char *action) {
    const char *helped = is("writer.news")         ? "keeper.heard:1:slow,"
                         : is("writer.collided")   ? "writer.chosen:1:slow,"
                         : is("reader.overtaken")  ? "reader.chosen:1:slow,"
                         : is("keeper.superseded") ? "keeper.lost:1:slow," /* frames are written in between */
                                                   : "";
    int nth = is("reader.unmapped") ? 1 : in("writer.") || in("reader.") || in("direct.") ? 3 : 1;

    snprintf(text, bytes, "%s%s:%d:%s", helped, at, nth, action);
}

/* Starts the victim and the parties that bring it to the point. */
static void bring(const char *fault, unsigned before) {
    struct stream *stream = &stage->stream[0];

    if (in("store.")) {
        store_kill();
        store_begin(fault);
        return;
    }
    if (in("reader.") || in("direct.") || in("attach.")) {
        /* in each pause, other ways to wait are used as well */
        victim = party_begin(is("direct.restored") ? 'd' : 'm', 0, 0, fault);
        AWAIT(actor_of(victim)->frames > 5 || struck(before), "%s: the victim does not begin", where);
        return;
    }
    struct party *owner = owner_of(0);
    stream->allowed = 0;
    victim = party_begin('w', 0, PERIOD, fault);
    AWAIT(actor_of(victim)->beats > 1 || struck(before), "%s: the victim does not begin", where);
    party_end(owner, SIGKILL);
    stream->allowed = 1u << victim->index;
    AWAIT(stream->owner == victim->index || struck(before), "%s: the victim does not write", where);
}

/* Stops the writer during a restart of the store until another writer is admitted. */
static void outlast(unsigned before) {
    uint32_t terms = stage->stream[0].terms;

    party_stop(victim);
    store_kill();
    store_begin(NULL);
    stage->stream[0].allowed = ~0u;
    await_takeover(0, terms + 1, where);
    party_go_on(victim);
    AWAIT(struck(before), "%s: never learns that it was superseded", where);
}

/* The worker of the store: another one continues, and no client notices. */
static void worker_killed(void) {
    AWAIT(store_worker() && store_worker() != stage->journal.pid, "%s: no other worker", where);
    await_frames(1, 10, 0, where);
}

static void killed(bool wrote, uint32_t terms, bool all) {
    if (!victim && !all) {
        worker_killed();
        return;
    }
    if (!victim) {
        uint64_t others = stage->stream[1].done;

        store_ended();
        nap(STOPPED);
        AWAIT(stage->stream[1].done > others + 20, "%s: no frames without a store", where);
        await_frames(1, 10, 0, where);
        store_begin(NULL);
        return;
    }
    party_ended(victim, SIGKILL);
    if (wrote) {
        const struct party *first = await_takeover(0, terms + 1, where);

        if (!first)
            return;
        last_takeover = takeover_done(0, terms + 1, stage->journal.time, first);
        if (!in("keeper.")) /* at these points the store is away as well */
            takeover_check(&last_takeover, where);
        worst_takeover = last_takeover.whole > worst_takeover.whole ? last_takeover : worst_takeover;
        takeovers++;
    }
}

static void stopped(bool wrote) {
    uint64_t beats = victim ? actor_of(victim)->beats : 0;

    if (victim)
        victim->stopped = true;
    longest_gap(1);
    uint64_t stumbled = stage->journal.passed[DDX_AT_READER_UNMAPPED];
    nap(STOPPED);
    if (!victim && stage->journal.passed[DDX_AT_READER_UNMAPPED] != stumbled)
        fail("%s: the writer uses a slot that the store had no time to tell its readers of", where);
    await_frames(1, 20, 0, where);
    if (!wrote && victim)
        await_frames(0, 20, 0, where);
    int64_t gap = longest_gap(1);
    worst_gap = gap > worst_gap ? gap : worst_gap;
    if (!victim) {
        store_go_on();
        return;
    }
    kill(victim->pid, SIGCONT);
    victim->stopped = false;
    if (is("claim.ended") || is("attach.ended"))
        party_ended(victim, SIGTERM);
    else {
        AWAIT(actor_of(victim)->beats > beats + 3, "%s: does not go on", where);
        if (is("keeper.superseded"))
            AWAIT(stage->stream[0].lost > 0, "%s: no frames counted as lost", where);
        party_end(victim, SIGKILL);
    }
}

static void refill(void) {
    unsigned writers = 0;

    for (unsigned i = 0; i < ACTORS; i++)
        writers += party[i].pid && party[i].kind == 'w' && party[i].stream == 0;
    for (; writers < 2; writers++)
        party_begin('w', 0, PERIOD, NULL);
}

/* A slot is still unknown to a reader, which meets it in each round. */
static bool stumbles(void) {
    uint64_t before = stage->journal.passed[DDX_AT_READER_UNMAPPED];

    nap(0.1);
    return stage->journal.passed[DDX_AT_READER_UNMAPPED] != before;
}

static void walk_point(unsigned point, const char *action) {
    struct party *liar = NULL;
    char fault[96];
    uint32_t terms;

    at = ddx_point_name[point];
    snprintf(where, sizeof where, "%s %s", at, action);
    fault_text(fault, sizeof fault, action);
    takeover_begin();
    unsigned before = stage->journal.struck;
    int64_t until = ddx_time_now() + (int64_t)(PATIENCE * 1e9);
    victim = NULL;
    if (is("writer.collided"))
        liar = party_begin('l', 0, 0, NULL);
    bring(fault, before);
    if (is("keeper.superseded"))
        outlast(before);
    for (unsigned turn = 0; !wait_struck(before, turn ? 0.02 : 0.05); turn++) {
        if (ddx_time_now() > until)
            fail("%s: never reached", where);
        stimulate(turn, before);
    }
    if (stage->journal.point != point || (victim && stage->journal.pid != victim->pid))
        fail("%s: another program was struck", where);
    terms = stage->stream[0].terms;
    bool wrote = victim && victim->kind == 'w' && !is("keeper.superseded");
    stage->stream[0].allowed = ~0u;
    if (!strcmp(action, "stop"))
        stopped(wrote);
    else
        killed(wrote, terms, !strcmp(action, "end"));
    if (liar)
        party_end(liar, SIGKILL);
    refill();
    /* Afterwards frames continue, and new programs are admitted. */
    await_frames(0, 5, 0, where);
    if (is("reader.unmapped"))
        AWAIT(!stumbles(), "%s: a reader never hears of a slot", where);
    victim = NULL;
    struct party *newcomer = party_begin('m', 0, 0, NULL);
    AWAIT(actor_of(newcomer)->frames >= 3, "%s: a new reader gets no frames", where);
    party_end(newcomer, SIGTERM);
    if (waitpid(store_process, NULL, WNOHANG))
        fail("%s: the store has ended", where);
    if (wrote && !strcmp(action, "kill"))
        printf("%-24s takeover %.1f ms\n", where, (double)last_takeover.whole / 1e6);
    else
        printf("%s\n", where);
}

int test_walk(const char *only) {
    unsigned walked = 0, part = 0, parts = 1;

    if (only && sscanf(only, "%u/%u", &part, &parts) == 2 && part < parts)
        only = NULL;

    store_begin(NULL);
    party_begin('w', 0, PERIOD, NULL);
    AWAIT(stage->stream[0].terms == 1, "no program writes");
    party_begin('w', 0, PERIOD, NULL);
    for (unsigned i = 0; i < 3; i++)
        party_begin("nod"[i], 0, 0, NULL);
    party_begin('w', 1, PERIOD, NULL);
    party_begin('o', 1, 0, NULL);
    await_frames(0, 10, 1, "at first");
    await_frames(1, 10, 1, "at first");
    for (unsigned point = 0; point < DDX_POINT_COUNT; point++) {
        if (point % parts != part || (only && !strstr(ddx_point_name[point], only)))
            continue;
        walk_point(point, "kill");
        walk_point(point, "stop");
        if (!strncmp(ddx_point_name[point], "store.", 6))
            walk_point(point, "end");
        walked++;
    }
    if (!walked)
        fail("there is no point %s", only);
    printf("%u points passed, %u takeovers; longest gap of others while one was stopped %.1f ms\n", walked, takeovers,
           (double)worst_gap / 1e6);
    if (takeovers)
        printf("worst takeover %s\n", takeover_text(&worst_takeover));
    return 0;
}
