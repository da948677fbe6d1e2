/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "judge.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

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

enum verdict judge(const struct former *former, const struct sight *before, const struct sight *now,
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
