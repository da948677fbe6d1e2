/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "deficit.h"

#include <errno.h>
#include <math.h>

#include "tuning.h"

/* The send time of the newest packet that arrived. */
static int64_t newest_arrival(const struct history *media, const struct history *repairs, uint32_t highest,
                              bool has_repair, uint32_t repair) {
    int64_t sent = history_sent(media, highest);

    return has_repair && history_sent(repairs, repair) > sent ? history_sent(repairs, repair) : sent;
}

static uint64_t newest_total(const struct history *media, const struct history *repairs, uint32_t highest,
                             bool has_repair, uint32_t repair) {
    uint64_t total = media->total[highest % HISTORY_PACKETS];

    return has_repair && repairs->total[repair % HISTORY_PACKETS] > total ? repairs->total[repair % HISTORY_PACKETS]
                                                                          : total;
}

static int64_t least_trip(const struct deficit *deficit) {
    return deficit->trip_least[0] < deficit->trip_least[1] ? deficit->trip_least[0] : deficit->trip_least[1];
}

static int64_t longest_trip(const struct deficit *deficit) {
    return deficit->trip_most[0] > deficit->trip_most[1] ? deficit->trip_most[0] : deficit->trip_most[1];
}

/* Compares the shortest round trip of a short period with that of the last seconds: the difference is a queue.
 * `arrived`: when the newest packet arrived, `total`: bytes sent with it. */
static void learn_queue(struct deficit *deficit, int64_t now, int64_t trip, int64_t arrived, uint64_t total) {
    if (!deficit->begun || now - deficit->least_begun >= tuning.trip_period) {
        deficit->trip_least[1] = deficit->begun ? deficit->trip_least[0] : trip;
        deficit->trip_least[0] = trip;
        deficit->least_begun = now;
    }
    if (trip < deficit->trip_least[0])
        deficit->trip_least[0] = trip;
    if (!deficit->begun || trip < deficit->trip_now)
        deficit->trip_now = trip;
    int64_t least = least_trip(deficit);
    deficit->delay = trip - least;
    if (deficit->begun && now - deficit->queue_begun <
                              (deficit->delay > tuning.queue_late ? tuning.queue_period_late : tuning.queue_period))
        return;
    bool full = deficit->queue > tuning.queue;
    deficit->queue = deficit->trip_now - least;
    full &= deficit->queue > tuning.queue;
    deficit->link = full && arrived > deficit->queue_time && total > deficit->queue_total
                        ? (double)(total - deficit->queue_total) * 8e9 / (double)(arrived - deficit->queue_time)
                        : 0;
    deficit->queue_time = arrived;
    deficit->queue_total = total;
    deficit->queue_begun = now;
    deficit->trip_now = trip;
}

/* Whether packets usually wait for those before them: the link carries hardly more than is sent. */
static bool is_narrow(const struct deficit *deficit) {
    return deficit->begun && deficit->trip - least_trip(deficit) > tuning.narrow;
}

/* How long a packet may take more than the last one that arrived, before it counts as lost: as much as round trips
 * differed lately, since a narrow link needs time for each packet, and packets wait for those before them. Where
 * packets are lost, less: of 100 ms such a link has time for one repair, so it must begin soon. */
static int64_t margin_of(struct deficit *deficit, int64_t now, int64_t trip, double loss) {
    if (!deficit->begun || now - deficit->most_begun >= tuning.margin_period) {
        deficit->trip_most[1] = deficit->begun ? deficit->trip_most[0] : trip;
        deficit->trip_most[0] = trip;
        deficit->most_begun = now;
    }
    if (trip > deficit->trip_most[0])
        deficit->trip_most[0] = trip;
    int64_t more = longest_trip(deficit) - trip;
    int64_t most = is_narrow(deficit) ? tuning.margin_most_narrow : tuning.margin_most;
    return tuning.jitter + (loss > tuning.margin_loss && more > most ? most : more);
}

/* Whether the oldest packet of which the receiver does not know yet waits before the link. Where packets are lost, it
 * was lost more likely. */
static bool is_held(const struct deficit *deficit, const struct history *media, int64_t now) {
    int64_t usual = least_trip(deficit) + tuning.link_full, longest = longest_trip(deficit);

    return deficit->loss <= tuning.margin_loss && history_has(media, deficit->highest + 1) &&
           now - history_sent(media, deficit->highest + 1) > (longest > usual ? longest : usual);
}

/* `run` packets were lost after the last one that arrived. When packets arrive again, the run before it is over. */
static void learn_run(struct deficit *deficit, unsigned run) {
    if (run < deficit->run)
        deficit->run_mean +=
            ((deficit->run < tuning.run_packets_most ? deficit->run : tuning.run_packets_most) - deficit->run_mean) / 8;
    deficit->run = run;
}

/*
 * The number of packets to have on the way for `needed` missing ones. With a long delay fewer rounds are left, so the
 * frame counts as older. Of a few packets probably all arrive; of many, some are lost. Where losses come in runs, all
 * arrive or none, and more packets would not help. On a narrow link they would delay all packets after them.
 */
static unsigned packets_to_send(const struct deficit *deficit, unsigned needed, int64_t age) {
    double loss = deficit->loss < tuning.loss_most ? deficit->loss : tuning.loss_most;

    if (deficit->run_mean > tuning.in_runs_packets || is_narrow(deficit))
        return needed;
    age += deficit->trip > tuning.short_trip ? 2 * (deficit->trip - tuning.short_trip) : 0;
    double sure = age < tuning.late ? 0 : age < tuning.very_late ? tuning.late_sure : tuning.very_late_sure;
    if (needed < tuning.many_packets && age < tuning.late)
        return needed;
    return (unsigned)((needed + sure * sqrt(needed * loss)) / (1 - loss) + 0.5);
}

/* Repair packets and probes on their way. */
static unsigned count_flying(const struct deficit *deficit, const struct history *repairs, unsigned *probes) {
    unsigned count = 0;

    *probes = 0;
    for (uint32_t number = repairs->newest;
         history_has(repairs, number) && number != deficit->repair && history_sent(repairs, number) > deficit->covered;
         number--)
        *(history_written(repairs, number) == HISTORY_PROBE ? probes : &count) += 1;
    return count;
}

/* Finds the end of an outage. A receiver that does not know probes gets repair packets instead, one at a time. */
static void search_end_of_outage(struct deficit *deficit, unsigned coming, unsigned probing) {
    bool known = deficit->probed < tuning.probes_unanswered;

    if (!coming && !probing)
        deficit->probes = known ? tuning.probes : 1;
    deficit->wanted = !known && !coming;
}

static void decide_repair(struct deficit *deficit, const struct history *media, const struct history *repairs,
                          int64_t now) {
    unsigned probing, coming = count_flying(deficit, repairs, &probing);

    learn_run(deficit, history_between(media, deficit->arrival, deficit->covered) +
                           history_between(repairs, deficit->arrival, deficit->covered));
    deficit->needed = deficit->missing;
    /* If packets are late and hardly one is lost, the newest ones wait before the link, and repair would wait, too. */
    if (deficit->delay <= tuning.queue || deficit->loss > tuning.margin_loss)
        deficit->needed += history_until(media, deficit->highest, deficit->covered);
    deficit->wanted = deficit->probes = 0;
    if (!deficit->needed)
        return;
    deficit->first = deficit->missing ? deficit->base : deficit->highest + 1;
    unsigned packets = packets_to_send(deficit, deficit->needed, now - history_written(media, deficit->first));
    if (deficit->run >=
        (deficit->run_mean > tuning.in_runs_packets ? tuning.quiet_packets_in_runs : tuning.quiet_packets))
        search_end_of_outage(deficit, coming, probing);
    else if (packets > coming)
        deficit->wanted = packets - coming;
}

/*
 * Takes what is impossible out of a report. A forged repair packet lets an honest receiver believe that packets were
 * sent that were not, at most REPORT_AHEAD of them, and that a repair packet with any number has arrived.
 */
static void correct_report(struct report *report, const struct history *media, const struct history *repairs) {
    unsigned ahead = (uint16_t)(report->highest - media->newest);

    if (ahead && ahead <= REPORT_AHEAD) {
        report->highest = (uint16_t)media->newest;
        if ((uint16_t)(report->base - report->highest - 1) < ahead)
            report->base = (uint16_t)(report->highest + 1);
        unsigned known = (uint16_t)(report->highest + 1 - report->base);
        report->missing = report->missing > ahead ? (uint16_t)(report->missing - ahead) : 0;
        report->missing = report->missing < known ? report->missing : (uint16_t)known;
    }
    report->has_repair =
        report->has_repair && repairs->count && history_has(repairs, history_find(repairs, report->highest_repair));
}

int deficit_report(struct deficit *deficit, const struct history *media, const struct history *repairs, int64_t now,
                   const struct report *from) {
    struct report corrected = *from, *report = &corrected;

    if (!media->count)
        return -EBADMSG;
    correct_report(report, media, repairs);
    uint32_t highest = history_find(media, report->highest), repair = history_find(repairs, report->highest_repair);
    if (!history_has(media, highest) || report->age >= REPORT_OLDEST_NS)
        return -ESTALE;
    int64_t arrival = newest_arrival(media, repairs, highest, report->has_repair, repair);
    int64_t trip = now - arrival - report->age;
    if (trip < 0)
        return -EBADMSG;
    int64_t margin = margin_of(deficit, now, trip, report->loss / 256.0);
    int64_t covered = arrival + (report->age > margin ? report->age - margin : 0);
    if (deficit->begun && covered < deficit->covered)
        return -ESTALE;
    learn_queue(deficit, now, trip, now - report->age,
                newest_total(media, repairs, highest, report->has_repair, repair));
    deficit->trip = deficit->begun ? deficit->trip + (trip - deficit->trip) / 8 : trip;
    deficit->begun = true;
    deficit->covered = covered;
    deficit->arrival = arrival;
    deficit->heard = now;
    deficit->base = highest - (uint16_t)(report->highest - report->base);
    deficit->highest = highest;
    deficit->missing = report->missing;
    deficit->repair = report->has_repair ? repair : repairs->newest - repairs->count;
    deficit->loss = report->loss / 256.0;
    if (report->has_repair && history_written(repairs, repair) == HISTORY_PROBE)
        deficit->probed = 0;
    deficit->held = is_held(deficit, media, now);
    decide_repair(deficit, media, repairs, now);
    return 0;
}
