/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * One party, of stream 0 or not, is stopped, and writer and readers of stream 0 continue as before: periods with and
 * without the stop alternate, and their numbers of frames and delays are compared. The limits are generous, since other
 * load affects both.
 */
#include <string.h>

#include "director.h"
#include "tests.h"

#define PERIOD 0.004
#define WINDOW 0.3
#define SETTLE 0.1
#define TURNS 4
#define FEWEST 0.6  /* of the frames */
#define LONGEST 2.5 /* times the median delay, ... */
#define SLACK 500.0 /* ... and this many us */

struct sample {
    double frames;           /* written, and seen by all observers together */
    unsigned count;          /* of entries in: */
    uint32_t delay[1 << 16]; /* us */
};

struct scene {
    const char *name, *fault;
    char kind;       /* of the party that is stopped, 's' for the store */
    unsigned stream; /* that it belongs to */
    bool replaces;   /* stops in the middle of a takeover, after its writer died */
};

static struct party *guest;

static bool observer(const struct party *p) {
    return p->pid && p != guest && p->kind == 'n' && p->stream == 0;
}

static void observe(struct sample *sample) {
    uint64_t before[ACTORS], written = stage->stream[0].done;

    for (unsigned i = 0; i < ACTORS; i++)
        before[i] = stage->actor[i].frames;
    nap(WINDOW);
    look();
    sample->frames += (double)(stage->stream[0].done - written);
    for (unsigned i = 0; i < ACTORS; i++)
        if (observer(&party[i])) {
            uint64_t frames = stage->actor[i].frames;

            sample->frames += (double)(frames - before[i]);
            for (uint64_t n = before[i]; n < frames && sample->count < sizeof sample->delay / sizeof(uint32_t); n++)
                sample->delay[sample->count++] = stage->actor[i].delay[n % DELAYS];
        }
}

static int by_size(const void *a, const void *b) {
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;

    return x < y ? -1 : x > y;
}

static double median(struct sample *sample) {
    qsort(sample->delay, sample->count, sizeof *sample->delay, by_size);
    return sample->count ? sample->delay[sample->count / 2] : 0;
}

static void stop(const struct scene *scene) {
    unsigned before = stage->journal.struck;

    if (scene->kind == 's') {
        store_stop();
        return;
    }
    if (!scene->fault) {
        guest->stopped = true;
        kill(guest->pid, SIGSTOP);
        return;
    }
    if (scene->replaces)
        party_end(owner_of(scene->stream), SIGKILL);
    guest = party_begin(scene->kind, scene->stream, PERIOD, scene->fault);
    guest->stopped = true;
    AWAIT(stage->journal.struck != before, "%s: never", scene->name);
}

static void go_on(const struct scene *scene) {
    uint32_t terms = stage->stream[scene->stream].terms;

    if (scene->kind == 's')
        store_go_on();
    else if (!scene->fault) {
        kill(guest->pid, SIGCONT);
        guest->stopped = false;
    } else {
        party_end(guest, SIGKILL);
        guest = NULL;
        if (scene->replaces) {
            party_begin('w', scene->stream, PERIOD, NULL);
            AWAIT(stage->stream[scene->stream].terms > terms, "%s: no program takes over", scene->name);
        }
    }
    nap(0.02);
}

static void play(const struct scene *scene) {
    static struct sample with, without;

    memset(&with, 0, sizeof with);
    memset(&without, 0, sizeof without);
    guest = NULL;
    if (!scene->fault && scene->kind != 's') {
        guest = scene->kind == 'w' ? owner_of(scene->stream) : party_begin(scene->kind, scene->stream, 0, NULL);
        AWAIT(actor_of(guest)->frames > 3, "%s: does not begin", scene->name);
    }
    for (unsigned turn = 0; turn < TURNS; turn++) {
        observe(&without);
        stop(scene);
        nap(SETTLE); /* the writer has used all slots */
        observe(&with);
        go_on(scene);
    }
    double rate = with.frames / without.frames, before = median(&without), after = median(&with);
    printf("%s is stopped: %.0f of %.0f frames, delay %.0f us instead of %.0f\n", scene->name, with.frames,
           without.frames, after, before);
    if (rate < FEWEST)
        fail("%s is stopped: others get %.2f of the frames", scene->name, rate);
    if (after > LONGEST * before + SLACK)
        fail("%s is stopped: others get frames after %.0f us instead of %.0f", scene->name, after, before);
    if (guest && scene->kind != 'w')
        party_end(guest, SIGTERM);
}

int test_stop(void) {
    static const struct scene scenes[] = {
        {"a reader that holds a frame", NULL, 'h', 0, false},
        {"the writer of another item", NULL, 'w', 1, false},
        {"the store", NULL, 's', 0, false},
        {"a reader that has asked to be let in", "attach.sent:1:stop", 'n', 0, false},
        {"a reader that is being let in", "attach.epoch:1:stop", 'n', 0, false},
        {"another item's next writer, in the middle of taking over,", "claim.control:1:stop", 'w', 1, true},
    };

    store_begin(NULL);
    for (unsigned stream = 0; stream < STREAMS; stream++) {
        party_begin('w', stream, PERIOD, NULL);
        party_begin('n', stream, 0, NULL);
        party_begin(stream ? 'o' : 'n', stream, 0, NULL); /* few slots in stream 0 */
    }
    await_frames(0, 20, 1, "at first");
    await_frames(1, 20, 1, "at first");
    for (unsigned i = 0; i < sizeof scenes / sizeof *scenes; i++)
        play(&scenes[i]);
    return 0;
}
