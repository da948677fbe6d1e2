/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "feedback.h"

#include <errno.h>
#include <math.h>

#include "tuning.h"

#define LOSS_MEMORY_NS 10e9
#define REPORTS_A_SECOND 200 /* read from a reporter in a second */
#define CLAIMS_DEPTH_NS (4 * SECOND)
#define CLAIMS_SHARE_ALL 0.65 /* parts of the rate: what the smallest frames and their headers leave */
#define CLAIMS_SHARE_EACH 0.48
#define CLAIMS_FILL_FIRST 0.5 /* how full they are at first */
#define CLAIMS_SHARE_HOPELESS 0.25
#define PROBES_SHARE 0.1 /* of the rate */
#define PROBES_DEPTH_NS (SECOND / 2)
#define CLAIM_BYTES 1400 /* bytes that must be left: more than any repair packet */

/* Shares of 1 kbit/s are enough for the bucket, and keep the rate positive. */
static void init_claims(struct budget *claims, int64_t rate, double share, int64_t now) {
    budget_init(claims, 1000 + (int64_t)((double)rate * share), CLAIMS_DEPTH_NS, CLAIMS_FILL_FIRST, now);
}

void feedback_init(struct feedback *feedback, uint32_t media, int64_t rate, int64_t now) {
    *feedback = (struct feedback){.media = media, .rate = rate, .heard = INT64_MIN};
    init_claims(&feedback->claims, rate, CLAIMS_SHARE_ALL, now);
    budget_init(&feedback->probes, 1000 + (int64_t)((double)rate * PROBES_SHARE), PROBES_DEPTH_NS, 1, now);
}

static bool is_active(const struct feedback_reporter *reporter, int64_t now) {
    return reporter->used && now - reporter->deficit.heard < FEEDBACK_GONE_NS;
}

/* Whether it had losses shortly before its last report. */
static bool is_lossy(const struct feedback_reporter *reporter) {
    return reporter->used && reporter->deficit.heard - reporter->lossy < FEEDBACK_CALM_NS;
}

/* Whether it fell silent while it had losses, and may still need repair. */
static bool is_missed(const struct feedback_reporter *reporter, int64_t now) {
    return is_lossy(reporter) && !is_active(reporter, now) && now - reporter->deficit.heard < FEEDBACK_KEPT_NS;
}

int64_t feedback_silence(const struct feedback *feedback, int64_t now) {
    int64_t active = INT64_MIN, missed = INT64_MIN;

    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++) {
        const struct feedback_reporter *reporter = &feedback->reporter[i];
        int64_t heard = reporter->deficit.heard;

        if (is_missed(reporter, now) && heard > missed)
            missed = heard;
        if (is_active(reporter, now) && is_lossy(reporter) && heard > active)
            active = heard;
    }
    if (active != INT64_MIN)
        return now - active;
    if (missed != INT64_MIN)
        return now - missed;
    return feedback->heard == INT64_MIN ? INT64_MAX : now - feedback->heard;
}

bool feedback_is_calm(const struct feedback *feedback, int64_t now) {
    bool reports = false;

    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++) {
        if (is_missed(&feedback->reporter[i], now) ||
            (is_active(&feedback->reporter[i], now) && is_lossy(&feedback->reporter[i])))
            return false;
        reports |= is_active(&feedback->reporter[i], now);
    }
    return reports;
}

/* ---- Reporters ---- */

static unsigned count_sharing(const struct feedback *feedback, uint64_t address) {
    unsigned count = 0;

    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++)
        count += feedback->reporter[i].used && feedback->reporter[i].address == address;
    return count;
}

static bool is_calm(const struct feedback_reporter *reporter, int64_t now) {
    return now - reporter->begun >= FEEDBACK_CALM_NS && now - reporter->lossy >= FEEDBACK_CALM_NS;
}

/* A place for a new reporter: a free one; else, if its address has none, that of a reporter that shares an address;
 * else, if it lacks packets, that of one without losses; else, if its address has none, that of one that fell silent.
 * NULL if there is no room. */
static struct feedback_reporter *find_room(struct feedback *feedback, int64_t now, uint64_t address, bool lacks) {
    struct feedback_reporter *shared = NULL, *calm = NULL, *missed = NULL;

    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++) {
        struct feedback_reporter *reporter = &feedback->reporter[i];

        if (is_missed(reporter, now))
            missed = reporter;
        else if (!is_active(reporter, now))
            return reporter;
        else if (count_sharing(feedback, reporter->address) > 1)
            shared = reporter;
        if (is_active(reporter, now) && is_calm(reporter, now))
            calm = reporter;
    }
    bool first = !count_sharing(feedback, address);
    if (first && shared)
        return shared;
    return lacks && calm ? calm : first ? missed : NULL;
}

static struct feedback_reporter *find_reporter(struct feedback *feedback, uint32_t ssrc, uint64_t address) {
    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++) {
        struct feedback_reporter *reporter = &feedback->reporter[i];

        if (reporter->used && reporter->ssrc == ssrc && reporter->address == address)
            return reporter;
    }
    return NULL;
}

static void begin_reporter(struct feedback *feedback, struct feedback_reporter *reporter, const struct report *report,
                           uint64_t address, int64_t now) {
    *reporter = (struct feedback_reporter){
        .used = true, .ssrc = report->reporter, .address = address, .begun = now, .lossy = now - FEEDBACK_CALM_NS};
    budget_init(&reporter->reports, 8 * REPORTS_A_SECOND, SECOND / 2, 1, now);
    init_claims(&reporter->claims, feedback->rate, CLAIMS_SHARE_EACH, now);
    init_claims(&reporter->hopeless, feedback->rate, CLAIMS_SHARE_HOPELESS, now);
}

/* Notes whether the reporter has losses, and grants it fewer probes if it is one of several. */
static void note_report(struct feedback *feedback, struct feedback_reporter *reporter, int64_t now) {
    if (reporter->deficit.needed || reporter->deficit.loss > 0)
        reporter->lossy = now;
    if (reporter->deficit.probes > tuning.probes_many && !feedback_single(feedback, now))
        reporter->deficit.probes = tuning.probes_many;
}

static enum feedback_count outcome_of(int error) {
    return !error ? FEEDBACK_USED : error == -ESTALE ? FEEDBACK_STALE : FEEDBACK_GARBAGE;
}

/* A new reporter gets a place only if its report is possible. */
static enum feedback_count first_report(struct feedback *feedback, int64_t now, const struct report *report,
                                        uint64_t address) {
    struct deficit deficit = {0};
    int error = deficit_report(&deficit, &feedback->sent, &feedback->repairs, now, report);
    struct feedback_reporter *room = error ? NULL : find_room(feedback, now, address, deficit.needed);

    if (error || !room)
        return error ? outcome_of(error) : FEEDBACK_FLOOD;
    begin_reporter(feedback, room, report, address, now);
    room->deficit = deficit;
    note_report(feedback, room, now);
    return FEEDBACK_USED;
}

static enum feedback_count use_report(struct feedback *feedback, int64_t now, const struct report *report,
                                      uint64_t address) {
    struct feedback_reporter *reporter = find_reporter(feedback, report->reporter, address);

    if (!reporter)
        return first_report(feedback, now, report, address);
    if (!budget_take(&reporter->reports, now, 1))
        return FEEDBACK_FLOOD;
    int error = deficit_report(&reporter->deficit, &feedback->sent, &feedback->repairs, now, report);
    if (!error)
        note_report(feedback, reporter, now);
    return outcome_of(error);
}

static struct budget *claims_of(struct feedback_reporter *reporter) {
    return reporter->deficit.loss > FEEDBACK_HOPELESS ? &reporter->hopeless : &reporter->claims;
}

static bool is_repairable(const struct feedback_reporter *reporter, int64_t now) {
    return is_active(reporter, now) && reporter->deficit.loss <= FEEDBACK_HOPELESS;
}

double feedback_least_loss(const struct feedback *feedback, int64_t now) {
    double least = 1;

    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++)
        if (is_repairable(&feedback->reporter[i], now))
            least = fmin(least, feedback->reporter[i].deficit.loss);
    return least < 1 ? least : 0;
}

static double rate_of_claims(struct budget *claims, int64_t now) {
    double spare = (double)budget_tokens(claims, now) - tuning.repair_kept * (double)budget_size(claims);

    return (double)claims->rate + spare * 8 * (double)SECOND / (double)tuning.repair_kept_after;
}

double feedback_repair_rate(struct feedback *feedback, int64_t now) {
    double least = INFINITY;

    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++)
        if (is_repairable(&feedback->reporter[i], now))
            least = fmin(least, rate_of_claims(&feedback->reporter[i].claims, now));
    return isinf(least) ? least : fmin(least, rate_of_claims(&feedback->claims, now));
}

static double worst_loss(const struct feedback *feedback, int64_t now) {
    double worst = 0;

    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++) {
        const struct feedback_reporter *reporter = &feedback->reporter[i];

        if ((is_active(reporter, now) || is_missed(reporter, now)) && reporter->deficit.loss > worst)
            worst = reporter->deficit.loss;
    }
    return worst;
}

void feedback_losses(const struct feedback *feedback, int64_t now, double *loss, double *run) {
    *loss = *run = 0;
    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++) {
        const struct deficit *deficit = &feedback->reporter[i].deficit;

        if (!is_active(&feedback->reporter[i], now))
            continue;
        *loss = deficit->loss > *loss ? deficit->loss : *loss;
        *run = deficit->run_mean > *run ? deficit->run_mean : *run;
    }
}

/* Whether a receiver's losses come in runs. */
static bool has_runs(const struct feedback *feedback, int64_t now) {
    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++) {
        const struct deficit *deficit = &feedback->reporter[i].deficit;

        if (is_active(&feedback->reporter[i], now) && deficit->run_mean > tuning.in_runs_packets && deficit->loss > 0)
            return true;
    }
    return false;
}

const struct deficit *feedback_nearest(const struct feedback *feedback, int64_t now) {
    const struct deficit *found = NULL;

    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++) {
        const struct deficit *deficit = &feedback->reporter[i].deficit;

        if (is_active(&feedback->reporter[i], now) && (!found || deficit->queue < found->queue))
            found = deficit;
    }
    return found;
}

const struct deficit *feedback_single(const struct feedback *feedback, int64_t now) {
    const struct deficit *found = NULL;

    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++) {
        if (!is_active(&feedback->reporter[i], now))
            continue;
        if (found)
            return NULL;
        found = &feedback->reporter[i].deficit;
    }
    return found;
}

/* Uses a report. */
static void learn_loss(struct feedback *feedback, int64_t now) {
    double worst = worst_loss(feedback, now);
    double part = feedback->heard == INT64_MIN ? 1 : (double)(now - feedback->heard) / LOSS_MEMORY_NS;

    feedback->mean_loss += (worst - feedback->mean_loss) * (part < 1 ? part : 1);
    feedback->loss = worst > feedback->mean_loss ? worst : feedback->mean_loss;
    feedback->in_runs = has_runs(feedback, now);
    feedback->heard = now;
}

bool feedback_report(struct feedback *feedback, int64_t now, const uint8_t *data, size_t size, uint64_t address) {
    struct report report;
    enum feedback_count result = FEEDBACK_GARBAGE;

    feedback->count[FEEDBACK_RECEIVED]++;
    if (!report_parse(data, size, &report) && report.media == feedback->media)
        result = report.has_state ? use_report(feedback, now, &report, address) : FEEDBACK_USED;
    feedback->count[result]++;
    if (result != FEEDBACK_USED)
        return false;
    if (report.has_state)
        learn_loss(feedback, now);
    return report.refresh;
}

/* ---- Wanted repair packets ---- */

/*
 * Whether it may cause another repair packet. While a part of the rate is left over, only its own claims count: without
 * repair a receiver can use no frame at all. Otherwise a single receiver waits, so that it takes no rate from frames;
 * of several, after all together have claimed enough, those that claimed little still may.
 */
static bool may_claim(struct feedback *feedback, struct feedback_reporter *reporter, int64_t now) {
    struct budget *own = claims_of(reporter);

    if (!feedback->spare && feedback_single(feedback, now))
        return false;
    bool enough = !feedback->spare && budget_tokens(&feedback->claims, now) < CLAIM_BYTES;
    return budget_tokens(own, now) >=
           (enough && budget_size(own) / 2 > CLAIM_BYTES ? budget_size(own) / 2 : CLAIM_BYTES);
}

unsigned feedback_wanted(struct feedback *feedback, int64_t now, uint32_t *first) {
    unsigned wanted = 0;

    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++) {
        struct feedback_reporter *reporter = &feedback->reporter[i];
        struct deficit *deficit = &reporter->deficit;

        if (!is_active(reporter, now) || !deficit->wanted || !may_claim(feedback, reporter, now))
            continue;
        if (!wanted || (int32_t)(deficit->first - *first) < 0)
            *first = deficit->first;
        if (deficit->wanted > wanted)
            wanted = deficit->wanted;
    }
    return wanted;
}

bool feedback_wants_probe(struct feedback *feedback, int64_t now, size_t bytes) {
    bool wanted = false;

    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++) {
        struct feedback_reporter *reporter = &feedback->reporter[i];

        wanted |= is_active(reporter, now) && reporter->deficit.probes &&
                  budget_tokens(claims_of(reporter), now) >= (int64_t)bytes;
    }
    return wanted && budget_tokens(&feedback->probes, now) >= (int64_t)bytes;
}

void feedback_probed(struct feedback *feedback, int64_t now, size_t bytes) {
    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++) {
        struct feedback_reporter *reporter = &feedback->reporter[i];

        if (!is_active(reporter, now) || !reporter->deficit.probes)
            continue;
        reporter->deficit.probed++;
        reporter->deficit.probes--;
        budget_take(claims_of(reporter), now, bytes);
    }
    budget_take(&feedback->probes, now, bytes);
}

void feedback_paid(struct feedback *feedback, int64_t now, size_t bytes) {
    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++) {
        struct feedback_reporter *reporter = &feedback->reporter[i];

        if (!is_active(reporter, now) || !reporter->deficit.wanted || !may_claim(feedback, reporter, now))
            continue;
        reporter->deficit.wanted--;
        reporter->deficit.needed -= reporter->deficit.needed > 0;
        budget_take(claims_of(reporter), now, bytes);
    }
    budget_take(&feedback->claims, now, bytes);
}
