/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The trial of a new version: it is kept once all has been well for five minutes in a row. Prints the reason why it is
 * not, at the deadline or at once if it will never be. Only then, or when this program crashes, its caller takes the
 * version back; a machine that hangs is reset by the watchdog, and its loader counts.
 */
#include <stdio.h>

#include "checks.h"
#include "choose.h"
#include "decide.h"
#include "judge.h"
#include "pace.h"
#include "place.h"
#include "rules.h"

enum { SSH_EVERY = 6 /* looks: each one is a line in the server's log */ };

struct trial {
    struct rules rules;
    struct former former;
    struct sight before, now;
    double good, spent; /* seconds */
    unsigned looks;
    char reason[REASON_MAX];
};

static void show(const struct trial *trial, const struct place *place, enum verdict verdict) {
    char text[REASON_MAX + 100];

    if (verdict == GOOD)
        snprintf(text, sizeof text, "all well for %.0f of %.0f s", trial->good, trial->rules.good);
    else
        snprintf(text, sizeof text, "%s; taken back in %.0f s", trial->reason,
                 trial->rules.deadline > trial->spent ? trial->rules.deadline - trial->spent : 0);
    place_note(place->progress, text);
}

static enum verdict look(struct trial *trial, const struct place *place) {
    trial->before = trial->now;
    sight_look(place, &trial->now);
    if (trial->former.ssh && (!trial->now.ssh || trial->looks % SSH_EVERY == 0))
        trial->now.ssh = ssh_answers(trial->rules.ssh);
    if (!trial->looks++)
        trial->before = trial->now;
    return judge(&trial->former, &trial->before, &trial->now, trial->reason);
}

/* Whether a person has decided meanwhile, or the trial is over for another reason. */
static bool is_over(const struct request *request) {
    struct block block;

    return !choose_read(request, &block) && !block_is_trial(&block, request->place.here);
}

/* 0: kept, or decided by a person; 1: to be taken back. */
static int run(struct trial *trial, const struct request *request) {
    const struct place *place = &request->place;
    bool well = false;

    for (double last = pace_now(), now;; last = now, pace_sleep(trial->rules.step)) {
        const enum verdict verdict = look(trial, place);
        now = pace_now();
        /* A stretch counts if all was well at its begin and at its end. */
        trial->good = verdict == GOOD && well ? trial->good + now - last : 0;
        well = verdict == GOOD;
        if (!trial->now.checking)
            trial->spent += now - last;
        if (is_over(request))
            return 0;
        if (trial->good >= trial->rules.good)
            return keep(request);
        if (verdict == WRONG || (verdict == BAD && trial->spent >= trial->rules.deadline))
            return 1;
        show(trial, place, verdict);
    }
}

int command_trial(const struct request *request) {
    static struct trial trial;
    const struct place *place = &request->place;
    struct release running;
    struct block block;

    if (!release_read(place->release, &running))
        return fail(1, "%s: names no board or no version", place->release);
    if (choose_read(request, &block))
        return 1;
    if (!block_is_trial(&block, place->here))
        return fail(2, "no version is on trial");
    rules_read(&trial.rules, place);
    former_read(&trial.former, place, running.version);
    services_read(place, &trial.now.services);
    if (!trial.now.services.count)
        return fail(1, "the list of services is missing");
    const int status = run(&trial, request);
    if (status)
        puts(trial.reason);
    remove(place->progress);
    return status;
}
