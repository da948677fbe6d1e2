/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Kills writers, readers, the store and its worker at random, as many times as requested; also stops worker and readers
 * for a while, takes programs' descriptors, and fills sockets. The same seed kills the same parties after the same
 * pauses. With an odd seed all run with real-time priority, if allowed, so that other load does not lengthen
 * takeovers. Prints one line of JSON at the end.
 */
#include <dirent.h>
#include <string.h>
#include <sys/resource.h>

#include "takeover.h"
#include "tests.h"

#define PERIOD 0.001
#define TAKEOVERS 4096     /* whose times are kept */
#define TOGETHER 400000000 /* ns: a takeover this soon after the store's death also waits for the store */

enum victim {
    WRITER,
    STANDBY,
    READER,
    WORKER,
    STOPPED_WORKER,
    STOPPED_READER,
    LIMITED,
    CROWD,
    STORE,
    WRITER_AND_STORE,
    VICTIMS
};

static uint64_t state;
static unsigned killed[VICTIMS];
static int64_t store_died;
/* ns; [1]: with the store away */
static struct takeover worst[2], sum[2];
static unsigned takeovers[2];
static int64_t took[TAKEOVERS]; /* ns, with a running store */

static unsigned chance(unsigned below) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (unsigned)(state >> 33) % below;
}

/* Some parties have a late keeper, as on a busy machine. */
static void begin(char kind) {
    party_begin(kind, 0, PERIOD, chance(3) ? NULL : "keeper.heard:1:slow");
}

static struct party *any(const char *kinds, const struct party *except, unsigned from) {
    struct party *found[ACTORS];
    unsigned count = 0;

    for (unsigned i = from; i < ACTORS; i++)
        if (party[i].pid && party[i].stream == 0 && strchr(kinds, party[i].kind) && &party[i] != except)
            found[count++] = &party[i];
    return count ? found[chance(count)] : NULL;
}

static void kill_store(void) {
    store_kill();
    store_died = ddx_time_now();
    nap(chance(3) ? 0 : chance(60) / 1000.0);
    store_begin(NULL);
}

/* For a moment, or until its messages no longer fit its socket. */
static void stop_worker(void) {
    pid_t worker;

    AWAIT((worker = store_worker()), "the store has no worker");
    kill(worker, SIGSTOP);
    nap(chance(60) / 1000.0);
    kill(worker, SIGCONT);
}

static void stop_reader(struct party *victim) {
    party_stop(victim);
    nap(chance(60) / 1000.0);
    party_go_on(victim);
}

/* Leaves the victim no descriptor, or a few, for a moment. */
static void limit(const struct party *victim) {
    struct rlimit all, few;
    char path[32];
    rlim_t used = 0;

    snprintf(path, sizeof path, "/proc/%d/fd", (int)victim->pid);
    DIR *folder = opendir(path);
    for (struct dirent *entry; folder && (entry = readdir(folder));)
        used = (rlim_t)atoi(entry->d_name) >= used ? (rlim_t)atoi(entry->d_name) + 1 : used;
    if (folder)
        closedir(folder);
    if (!used || prlimit(victim->pid, RLIMIT_NOFILE, NULL, &all))
        return; /* it has just begun */
    few = all;
    few.rlim_cur = used + chance(4);
    prlimit(victim->pid, RLIMIT_NOFILE, &few, NULL);
    nap(chance(60) / 1000.0);
    prlimit(victim->pid, RLIMIT_NOFILE, &all, NULL);
}

/* Adds more frames than a socket holds messages while the reader is stopped. */
static void crowd(struct party *victim) {
    struct party *guest[3];

    party_stop(victim);
    for (unsigned i = 0; i < 3; i++)
        guest[i] = party_begin('k', 0, 0, NULL);
    nap(chance(100) / 1000.0);
    for (unsigned i = 0; i < 3; i++)
        party_end(guest[i], SIGKILL);
    party_go_on(victim);
}

static void most(int64_t *worst_one, int64_t value) {
    *worst_one = value > *worst_one ? value : *worst_one;
}

static void book(struct takeover t, bool together) {
    if (!together)
        takeover_check(&t, "a killed writer");
    most(&worst[together].whole, t.whole);
    most(&worst[together].published, t.whole - t.seen);
    if (!together && takeovers[0] < TAKEOVERS)
        took[takeovers[0]] = t.whole;
    sum[together].whole += t.whole;
    sum[together].noticed += t.noticed;
    sum[together].granted += t.granted;
    sum[together].published += t.published;
    sum[together].seen += t.seen;
    takeovers[together]++;
}

static double mean_ms(int64_t ns) {
    return takeovers[0] ? (double)ns / takeovers[0] / 1e6 : 0;
}

static void kill_writer(bool and_store) {
    struct party *owner = owner_of(0);
    uint32_t terms = stage->stream[0].terms;

    takeover_begin();
    int64_t since = ddx_time_now();
    party_end(owner, SIGKILL);
    if (and_store)
        kill_store();
    const struct party *first = await_takeover(0, terms + 1, "a killed writer");
    if (first)
        book(takeover_done(0, terms + 1, since, first), since - store_died < TOGETHER);
    begin('w');
}

static void kill_party(struct party *victim, const char *kinds) {
    party_end(victim, SIGKILL);
    nap(chance(10) / 1000.0);
    begin(kinds[chance((unsigned)strlen(kinds))]);
}

static void kill_one(unsigned observers) {
    static const unsigned share[VICTIMS] = {43, 8, 18, 12, 3, 4, 3, 1, 5, 3};
    unsigned dice = chance(100), what = 0;

    while (dice >= share[what])
        dice -= share[what++];
    killed[what]++;
    switch (what) {
    case WRITER: kill_writer(false); break;
    case WRITER_AND_STORE: kill_writer(true); break;
    case STANDBY: kill_party(any("w", owner_of(0), 0), "w"); break;
    case READER: kill_party(any("nodcm", NULL, observers), "nodcm"); break;
    case WORKER: store_kill_worker(); break;
    case STOPPED_WORKER: stop_worker(); break;
    case LIMITED: limit(any("wnodcm", NULL, observers)); break;
    case CROWD: crowd(any("nodcm", NULL, observers)); break;
    case STOPPED_READER: stop_reader(any("nodcm", NULL, observers)); break;
    default: kill_store(); break;
    }
}

int test_random(unsigned kills, unsigned seed) {
    uint64_t seen = 0, missed = 0;

    /* Times are judged only in measured runs (tools/crash.py), and in half of them: the others share the machine with
     * other programs. */
    bool urgent = getenv("DDX_CRASH_URGENT") && seed % 2 && takeover_urgent();

    state = seed;
    store_begin(NULL);
    for (unsigned i = 0; i < 3; i++) /* these are never killed */
        party_begin("nod"[i], 0, 0, NULL);
    party_begin('w', 1, PERIOD, NULL);
    party_begin('o', 1, 0, NULL);
    for (unsigned i = 0; i < 3; i++)
        party_begin("ocm"[i], 0, 0, NULL);
    for (unsigned i = 0; i < 3; i++)
        party_begin('w', 0, PERIOD, NULL);
    await_frames(0, 300, 1, "at first");
    for (unsigned i = 0; i < kills; i++) {
        kill_one(5);
        nap(chance(30) / 1000.0);
        await_frames(1, 1, 0, "while others die");
        if (i % 20 == 19)
            await_frames(0, 5, 0, "after kills");
        if (i % 500 == 499)
            fprintf(stderr, "%u of %u\n", i + 1, kills);
    }
    await_frames(0, 20, 0, "at last");
    for (unsigned i = 0; i < 3; i++) {
        party_end(&party[i], SIGTERM);
        const struct actor *a = &stage->actor[i];

        if (a->frames + a->missed != a->last - a->first + 1)
            fail("%c%u: %llu seen and %llu missed are not what was written", party[i].kind, i,
                 (unsigned long long)a->frames, (unsigned long long)a->missed);
        seen += a->frames;
        missed += a->missed;
    }
    look();
    printf("{\"kills\":%u,\"seed\":%u,\"writers\":%u,\"standbys\":%u,\"readers\":%u,\"stores\":%u,"
           "\"writers_and_stores\":%u,\"workers\":%u,\"stopped\":%u,\"limited\":%u,\"crowds\":%u,"
           "\"frames_written\":%llu,\"terms\":%u,\"seen\":%llu,\"missed\":%llu,\"torn\":0,\"hangs\":0,"
           "\"takeovers\":%u,\"takeover_mean_ms\":%.1f,\"takeover_worst_ms\":%.1f,"
           "\"urgent\":%u,\"published_worst_ms\":%.1f,"
           "\"noticed_mean_ms\":%.1f,\"granted_mean_ms\":%.1f,\"published_mean_ms\":%.1f,\"seen_mean_ms\":%.1f,"
           "\"takeover_worst_ms_store_away\":%.1f,\"takeovers_store_away\":%u,\"takeover_ms\":[",
           kills, seed, killed[WRITER], killed[STANDBY], killed[READER], killed[STORE], killed[WRITER_AND_STORE],
           killed[WORKER], killed[STOPPED_WORKER] + killed[STOPPED_READER], killed[LIMITED], killed[CROWD],
           (unsigned long long)stage->stream[0].done, stage->stream[0].terms, (unsigned long long)seen,
           (unsigned long long)missed, takeovers[0], mean_ms(sum[0].whole), (double)worst[0].whole / 1e6, urgent,
           (double)worst[0].published / 1e6, mean_ms(sum[0].noticed), mean_ms(sum[0].granted),
           mean_ms(sum[0].published), mean_ms(sum[0].seen), (double)worst[1].whole / 1e6, takeovers[1]);
    for (unsigned i = 0; i < takeovers[0] && i < TAKEOVERS; i++)
        printf("%s%.1f", i ? "," : "", (double)took[i] / 1e6);
    puts("]}");
    return 0;
}
