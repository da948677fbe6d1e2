/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The trial of a new version: it is kept once all has been well for five minutes in a row. Prints the reason why it is
 * not, at the deadline or at once if it will never be. Only then, or when this program crashes, its caller takes the
 * version back; a machine that hangs is reset by the watchdog, and its loader counts.
 */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "decide.h"
#include "pace.h"
#include "place.h"
#include "sight.h"

enum { REASON_MAX = 200 };

enum verdict {
    GOOD,
    BAD,   /* it may become good */
    WRONG, /* it will not: a service refuses its settings */
};

__attribute__((format(printf, 3, 4))) static enum verdict because(enum verdict verdict, char reason[REASON_MAX],
                                                                  const char *format, ...) {
    va_list words;

    va_start(words, format);
    vsnprintf(reason, REASON_MAX, format, words);
    va_end(words);
    return verdict;
}

static enum verdict judge_services(const struct former *former, const struct services *before,
                                   const struct services *now, char *reason) {
    for (unsigned i = 0; i < now->count; i++) {
        const struct service *service = &now->list[i];
        if (!service->enabled || service->stopped || service->full ||
            (former->known && !former_has(former->runs, service->name)))
            continue;
        if (service->misconfigured)
            return because(WRONG, reason, "%s refuses its settings", service->name);
        if (!service->runs)
            return because(BAD, reason, "%s does not run", service->name);
        if (service->restarts > before->list[i].restarts)
            return because(BAD, reason, "%s died and had to be started again", service->name);
    }
    return GOOD;
}

/* Whether the service may be silent: a person has stopped or disabled it, its disk is full, or it is not one of this
 * version's. */
static bool may_rest(const struct services *services, const char *name) {
    for (unsigned i = 0; i < services->count; i++)
        if (!strcmp(services->list[i].name, name))
            return !services->list[i].enabled || services->list[i].stopped || services->list[i].full;
    return true;
}

static enum verdict judge_frames(const struct former *former, const struct sight *before, const struct sight *now,
                                 char *reason) {
    char names[WORDS_MAX], *rest = NULL;

    snprintf(names, sizeof names, "%s", former->flows);
    for (const char *name = strtok_r(names, " ", &rest); name; name = strtok_r(NULL, " ", &rest)) {
        const struct counter *is = frames_find(&now->frames, name), *was = frames_find(&before->frames, name);
        if (!may_rest(&now->services, name) && (!is || !was || is->passed <= was->passed))
            return because(BAD, reason, "%s: no new frame", name);
    }
    for (unsigned i = 0; i < now->frames.count; i++) {
        const struct counter *is = &now->frames.list[i], *was = frames_find(&before->frames, is->name);
        if (is->kind == RECORDER && is->lost > (was ? was->lost : 0) && !may_rest(&now->services, is->name))
            return because(BAD, reason, "%s loses frames", is->name);
        if (!former->known && is->kind != LOGGER && was && was->passed && is->passed <= was->passed &&
            !may_rest(&now->services, is->name))
            return because(BAD, reason, "%s: no new frame", is->name);
    }
    return GOOD;
}

/* An interface without a carrier is no fault: robots drive, cables are pulled. */
static enum verdict judge_network(const struct former *former, const struct network *now, char *reason) {
    char names[WORDS_MAX], *rest = NULL;

    snprintf(names, sizeof names, "%s", former->links);
    for (const char *name = strtok_r(names, " ", &rest); name; name = strtok_r(NULL, " ", &rest)) {
        const struct link *link = network_find(now, name);
        if (!link)
            return because(BAD, reason, "the network interface %s is missing", name);
        if (link->carrier && !link->address && former_has(former->addresses, name))
            return because(BAD, reason, "the network interface %s has no address", name);
    }
    return GOOD;
}

/*
 * Judge the machine by two looks, one after the other. For all but GOOD, `reason` says why. Without a former state,
 * each enabled service must run, and frames must continue once they flow.
 */
static enum verdict judge(const struct former *former, const struct sight *before, const struct sight *now,
                          char reason[REASON_MAX]) {
    *reason = 0;
    enum verdict verdict = judge_services(former, &before->services, &now->services, reason);
    if (verdict == GOOD && !now->frames.answered)
        verdict = because(BAD, reason, "the store does not answer");
    if (verdict == GOOD)
        verdict = judge_frames(former, before, now, reason);
    if (verdict == GOOD)
        verdict = judge_network(former, &now->network, reason);
    if (verdict == GOOD && former->ssh && !now->ssh)
        verdict = because(BAD, reason, "SSH does not answer");
    if (verdict == GOOD && former->watchdog && !now->watchdog)
        verdict = because(BAD, reason, "the watchdog is not active");
    return verdict;
}

enum { SSH_EVERY = 6 /* looks: each one is a line in the server's log */ };

struct trial {
    struct rules rules;
    struct former former;
    struct sight before, now;
    double good, spent, silent; /* seconds; silent: without an answer of the store */
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
        trial->silent = trial->now.frames.answered ? 0 : trial->silent + now - last;
        if (is_over(request))
            return 0;
        if (trial->good >= trial->rules.good)
            return keep(request);
        if (verdict == WRONG || (verdict == BAD && trial->spent >= trial->rules.deadline))
            return 1;
        /* ddxhealth feeds the watchdog only while the store answers. A machine that is reset forgets the reason. */
        if (trial->silent >= trial->rules.silence)
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
