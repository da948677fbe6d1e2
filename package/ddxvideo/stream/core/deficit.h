/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Repair packets that one receiver needs, by its reports. No sockets, no clock.
 *
 * A report covers all packets sent until a time that follows from the report alone: the newest packet that arrived was
 * sent at a known time, and nothing newer arrived for `age`. So each packet sent until then, less a margin for jitter,
 * has arrived, is counted as missing, or is lost; later ones may be on their way. This needs neither the round trip
 * time nor the receiver's clock, and distinguishes a lost last packet from one on its way. The margin is by how much
 * round trips differed in the last seconds: on a narrow link a packet comes after the one before it by the time that
 * the link needs for it (with a fixed margin of 3 ms, a link of -wire without loss had 0.35 repair packets a packet).
 * While packets are lost the margin is at most 13 ms, since each wait costs time for repair.
 *
 * Rules, each found in the simulation (tests/unit/ddxvideo_repair_sim.c):
 * - Only reports request repair packets. If they were repeated after a time, each of them would be sent twice on a
 *   link with a long delay.
 * - At first one packet for each missing one, some more if many are missing. After 60 ms, and again after 80
 *   ms (tuning.h), more of them, so that enough arrive in all likelihood: few frames get that old, and the pictures
 *   of all later frames depend on them.
 * - With a long delay fewer answers fit in 100 ms, so missing packets count as older than they are (round trip 20 ms:
 *   98.4 to 99.3 % usable at 30 % loss, 40 ms: 93.5 to 97.4 %). From 60 ms on, a fixed ratio without reports is better.
 * - Losses in runs: while nothing arrives, probes are sent, of 24 bytes, and no repair packets, of which all would be
 *   lost as well. After the first arrival all missing packets are sent at once. Repair packets that were sent again at
 *   each report emptied the bucket before the outage was over (outages of 40 ms: 46 % usable instead of 85 %). The mean
 *   length of the runs is 1.4 at 30 % independent loss, and 3 to 5 in bursts.
 * - Silence: a receiver with missing packets reports every 5 ms. So silence means that nothing is missing, or that
 *   nothing arrives. No packet is sent: without a report, repair packets cost more picture quality than they save.
 */
#ifndef DDXVIDEO_DEFICIT_H
#define DDXVIDEO_DEFICIT_H

#include "history.h"
#include "report.h"

struct deficit {
    bool begun;
    int64_t covered;                    /* packets sent until then have arrived, are missing or lost */
    int64_t arrival;                    /* send time of the newest packet that arrived */
    int64_t trip_least[2], least_begun; /* the shortest round trips of this period of seconds and of the last one */
    int64_t delay;                      /* by how much the last one was longer, */
    int64_t queue; /* and the shortest one of the last short period: packets wait before the link */
    int64_t trip_now, queue_begun, queue_time; /* of this short period: the shortest one, its start, the last arrival */
    uint64_t queue_total;                      /* bytes sent until then */
    double link;  /* bit/s that arrived in the last short period, if packets waited all the time; else 0 */
    int64_t trip; /* ns, smoothed round trip time */
    int64_t trip_most[2], most_begun; /* the longest round trips of this second and of the last one */
    bool held; /* at the last report a packet was later than all of them, though the link loses nothing: it is full */
    int64_t heard;                  /* time of the last report */
    uint32_t base, highest, repair; /* of the last report, extended; `repair`: the newest repair packet that arrived */
    unsigned missing;
    double loss;  /* 0 to 1, as reported */
    unsigned run; /* packets lost after the last one that arrived */
    double run_mean;
    unsigned needed; /* repair packets that the receiver lacks */
    unsigned wanted; /* repair packets to send now */
    unsigned probes; /* probes to send now; */
    unsigned probed; /* sent since the last one that was reported */
    uint32_t first;  /* the oldest media packet that they must cover */
};

/*
 * Use a report. 0; -EBADMSG if nothing was sent, or if packets arrived before they were sent, by its claim; -ESTALE if
 * it is older than a former report, or about forgotten packets. Packets up to REPORT_AHEAD ahead, and repair packets
 * that were never sent, are left out: without a key, forged repair packets can make a receiver report them.
 */
int deficit_report(struct deficit *deficit, const struct history *media, const struct history *repairs, int64_t now,
                   const struct report *report);

#endif
