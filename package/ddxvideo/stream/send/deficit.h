/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * What one receiver still needs, by its reports. No sockets, no clock.
 *
 * A report covers all packets sent until a time that follows from the report alone: the newest packet that arrived
 * was sent at a known time, and nothing newer arrived for `age`. So each packet sent until then, less a margin for
 * jitter, is there, counted as missing, or lost; later ones are in flight. This needs neither the round trip time nor
 * the receiver's clock, and tells a lost last packet from one that is on its way.
 *
 * Rules, each found in the simulation (tests/unit/ddxvideo_repair_sim.c):
 * - Only a report orders repair packets. A rule that repeats them after a time sends each of them twice at a long way.
 * - One packet for each missing one at first, some more where many are missing. After DEFICIT_LATE twice, after
 *   DEFICIT_VERY_LATE three times as many: few frames get that old, and the picture of each later frame depends on
 *   them.
 * - At a long way fewer answers fit in 100 ms, so what is missing counts as later than it is (20 ms there and back:
 *   98.4 to 99.3 % usable at 30 % loss, 40 ms: 93.5 to 97.4 %). From 60 ms on a fixed ratio without reports does
 *   better.
 * - Losses that come in runs need more at once. The mean length of the runs is 1.4 at 30 % independent loss, where
 *   nothing is added, and 3 to 5 in bursts. Among several receivers one is nearly always in a run: packets that were
 *   added for each of them would leave nothing for the pictures (four in bursts: 22 kbit/s of 250), so none are.
 * - Silence: a receiver that misses something reports every 10 ms. So silence means that nothing is missing, or that
 *   nothing gets through. No packet is sent: packets on suspicion cost more picture than they saved.
 */
#ifndef DDXVIDEO_DEFICIT_H
#define DDXVIDEO_DEFICIT_H

#include "history.h"
#include "report.h"

#define DEFICIT_MARGIN INT64_C(3000000)     /* ns, jitter of packets that is not taken for a loss */
#define DEFICIT_LATE INT64_C(60000000)      /* ns since the oldest missing frame was handed over */
#define DEFICIT_VERY_LATE INT64_C(80000000) /* ns */
#define DEFICIT_IN_RUNS 2.0                 /* mean length of runs above which losses certainly come in runs */

struct deficit {
    bool begun;
    bool shared;         /* set by the caller: other receivers report, too */
    int64_t covered;     /* packets sent until then are there, missing or lost */
    int64_t trip;        /* ns, smoothed round trip time */
    int64_t heard;       /* when the last report came */
    uint32_t base, highest, repair; /* of the last report, extended; `repair`: the newest repair packet that arrived */
    unsigned missing;
    double loss;    /* 0 to 1, as reported */
    unsigned run;   /* packets lost since the last one that arrived */
    double run_mean;
    unsigned wanted; /* repair packets that are to be sent now */
    uint32_t first;  /* the oldest media packet that they have to cover */
};

/*
 * A report came. 0; -EBADMSG if it is about packets that were never sent or claims to know of them before they were
 * sent; -ESTALE if it is older than one before, or about packets that are forgotten.
 */
int deficit_report(struct deficit *deficit, const struct history *media, const struct history *repairs, int64_t now,
                   const struct report *report);

#endif
