/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "deficit.h"

#include <errno.h>

#define RUN_ALONE 1.5 /* mean length of runs up to which losses count as independent */
#define MOST_MORE 8   /* packets that are added because of runs */
#define MANY 4
#define LOSS_MOST 0.5 /* for which packets are added */
#define SHORT_WAY INT64_C(12000000) /* ns there and back */
#define MOST_SUSPECTED 4
#define RUN_LONGEST 16 /* a longer run is an outage, which ends by itself */

/* When the newest packet that arrived was sent. */
static int64_t newest_arrival(const struct history *media, const struct history *repairs, uint32_t highest,
                              bool has_repair, uint32_t repair) {
    int64_t sent = history_sent(media, highest);

    return has_repair && history_sent(repairs, repair) > sent ? history_sent(repairs, repair) : sent;
}

/* `run` packets were lost after the last one that arrived. When packets arrive again, the run before it is over. */
static void learn_run(struct deficit *deficit, unsigned run) {
    if (run < deficit->run)
        deficit->run_mean += ((deficit->run < RUN_LONGEST ? deficit->run : RUN_LONGEST) - deficit->run_mean) / 8;
    deficit->run = run;
}

static unsigned more_in_runs(const struct deficit *deficit, double factor, unsigned most) {
    double more = (deficit->run_mean - RUN_ALONE) * factor;

    return more < 0 ? 0 : more > most ? most : (unsigned)more;
}

/*
 * How many packets are to be in flight for `needed` missing ones. At a long way fewer rounds are left, as if it were
 * later. That a few all arrive is likely; of many, some are lost.
 */
static unsigned enough(const struct deficit *deficit, unsigned needed, int64_t age) {
    double loss = deficit->loss < LOSS_MOST ? deficit->loss : LOSS_MOST;

    if (needed >= MANY)
        needed = (unsigned)(needed / (1 - loss));
    age += deficit->trip > SHORT_WAY ? 2 * (deficit->trip - SHORT_WAY) : 0;
    unsigned packets = age < DEFICIT_LATE ? needed : age < DEFICIT_VERY_LATE ? 2 * needed : 3 * needed;

    return packets + (deficit->run ? more_in_runs(deficit, 1.5, MOST_MORE) : 0);
}

static void decide(struct deficit *deficit, const struct history *media, const struct history *repairs, int64_t now) {
    unsigned gone = history_until(media, deficit->highest, deficit->covered);
    unsigned repairs_gone = history_until(repairs, deficit->repair, deficit->covered);
    unsigned flying = repairs->newest - deficit->repair - repairs_gone;
    unsigned needed = deficit->missing + gone;

    learn_run(deficit, gone + repairs_gone);
    deficit->wanted = 0;
    if (!needed)
        return;
    deficit->first = deficit->missing ? deficit->base : deficit->highest + 1;
    unsigned packets = enough(deficit, needed, now - history_written(media, deficit->first));
    if (packets > flying)
        deficit->wanted = packets - flying;
}

int deficit_report(struct deficit *deficit, const struct history *media, const struct history *repairs, int64_t now,
                   const struct report *report) {
    uint32_t highest = history_find(media, report->highest), repair = history_find(repairs, report->highest_repair);

    if (!media->count || (report->has_repair && !repairs->count))
        return -EBADMSG;
    if (!history_has(media, highest) || (report->has_repair && !history_has(repairs, repair)) ||
        report->age >= REPORT_OLDEST)
        return -ESTALE;
    int64_t arrival = newest_arrival(media, repairs, highest, report->has_repair, repair);
    int64_t trip = now - arrival - report->age;
    if (trip < 0)
        return -EBADMSG;
    int64_t covered = arrival + (report->age > DEFICIT_MARGIN ? report->age - DEFICIT_MARGIN : 0);
    if (deficit->begun && covered < deficit->covered)
        return -ESTALE;
    deficit->trip = deficit->begun ? deficit->trip + (trip - deficit->trip) / 8 : trip;
    deficit->begun = true;
    deficit->covered = covered;
    deficit->heard = now;
    deficit->base = highest - (uint16_t)(report->highest - report->base);
    deficit->highest = highest;
    deficit->missing = report->missing;
    deficit->repair = report->has_repair ? repair : repairs->newest - repairs->count;
    deficit->loss = report->loss / 256.0;
    decide(deficit, media, repairs, now);
    return 0;
}

/* The oldest packet that no report covers, if there is one. */
static bool next_uncovered(const struct deficit *deficit, const struct history *media, uint32_t *next) {
    *next = deficit->highest + 1 + history_until(media, deficit->highest, deficit->covered);
    return history_has(media, *next);
}

int64_t deficit_deadline(const struct deficit *deficit, const struct history *media) {
    uint32_t next;

    if (deficit->wanted || !more_in_runs(deficit, 1, MOST_SUSPECTED) || !next_uncovered(deficit, media, &next))
        return INT64_MAX;
    int64_t sent = history_sent(media, next), time = sent + deficit->trip + DEFICIT_SILENCE;
    if (time < deficit->heard + DEFICIT_SILENCE / 2)
        time = deficit->heard + DEFICIT_SILENCE / 2;
    if (time < deficit->suspected + DEFICIT_AGAIN)
        time = deficit->suspected + DEFICIT_AGAIN;
    return time - sent > DEFICIT_SUSPECT ? INT64_MAX : time;
}

void deficit_silence(struct deficit *deficit, const struct history *media, int64_t now) {
    uint32_t next;

    if (now < deficit_deadline(deficit, media) || !next_uncovered(deficit, media, &next))
        return;
    deficit->suspected = now;
    deficit->wanted = more_in_runs(deficit, 1, MOST_SUSPECTED);
    deficit->first = deficit->missing ? deficit->base : next;
}
