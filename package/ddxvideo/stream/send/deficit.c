/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "deficit.h"

#include <errno.h>

#define RUN_ALONE 1.5 /* mean length of runs up to which losses count as independent */
#define MORE 1.5      /* packets that are added for each packet of longer runs */
#define MOST_MORE 4
#define MANY 4
#define LOSS_MOST 0.5 /* a higher loss counts as this */
#define SHORT_WAY INT64_C(12000000) /* ns there and back */
#define RUN_LONGEST 16 /* a longer run is an outage, which ends by itself */

/* The send time of the newest packet that arrived. */
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

static unsigned more_in_runs(const struct deficit *deficit) {
    double more = deficit->run ? (deficit->run_mean - RUN_ALONE) * MORE : 0;

    return more < 0 ? 0 : more > MOST_MORE ? MOST_MORE : (unsigned)more;
}

/*
 * The number of packets to have on the way for `needed` missing ones. With a long delay fewer rounds are left, so the
 * frame counts as older. Of a few packets probably all arrive; of many, some are lost.
 */
static unsigned enough(const struct deficit *deficit, unsigned needed, int64_t age) {
    double loss = deficit->loss < LOSS_MOST ? deficit->loss : LOSS_MOST;

    if (deficit->shared && deficit->run_mean > DEFICIT_IN_RUNS)
        return needed;
    if (needed >= MANY)
        needed = (unsigned)(needed / (1 - loss));
    age += deficit->trip > SHORT_WAY ? 2 * (deficit->trip - SHORT_WAY) : 0;
    unsigned packets = age < DEFICIT_LATE ? needed : age < DEFICIT_VERY_LATE ? 2 * needed : 3 * needed;

    return packets + more_in_runs(deficit);
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
