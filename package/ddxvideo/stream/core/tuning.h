/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The numbers by which the sender divides its rate between pictures and repair. Where nothing else is said, a value was
 * found in the simulation (tests/unit/ddxvideo_repair_sim.c: 250 kbit/s, 30 % loss, round trips of 4 and 10 ms); what
 * all together give over a real sender and receiver is in docs/bench.md. Times are in ns, shares from 0 to 1.
 */
#ifndef DDXVIDEO_TUNING_H
#define DDXVIDEO_TUNING_H

#include "ddx_time.h"

static const struct {
    /* ---- The bucket ---- */
    int64_t bucket; /* of the rate that it holds */
    double fill_first;
    double fill;              /* that is kept for bursts of reported losses */
    double fill_in_runs_many; /* the same where losses come in runs, for several receivers: one of them always misses
                               * something, and smaller frames would look worse than a bucket that is never full */
    double fill_one_way;      /* the same without reports, for frames of different sizes only */
    double fill_frames_alone; /* in which the fill level is restored, for a single receiver: in fewer, frames differ so
                               * much that some look bad, */
    double fill_frames;       /* for several receivers, and without reports, */
    double fill_frames_in_runs; /* and for several where losses come in runs */
    double fill_reserve;        /* fill level up to which a single receiver cannot empty the bucket */
    double runs_packets;        /* mean length of runs at 30 % independent loss; from one more on, all come in runs */
    double shares_kept;         /* of the bytes sent before, in the shares of media and repair, each frame */

    /* ---- The link's rate ---- */
    int64_t link_full;       /* that packets wait before the link, above which frames are left out */
    int64_t link_full_now;   /* the same, of the last packet that arrived, while others are on their way */
    int64_t link_full_more;  /* that both are longer where packets are lost: then repair waits there as well */
    double link_full_share;  /* of the rate that a frame has then, if it is not left out, */
    int64_t link_full_after; /* and so long after it */
    int64_t link_held_most;  /* for which packets that stay away count as a full link, */
    int64_t link_held_apart; /* and without them, after which they count again */
    int64_t link_step;       /* from one change of the rate to the next */
    int64_t link_bucket;     /* what the bucket holds while the link is slower than -wire */
    double link_drain;       /* of the link's rate, while there is a queue */
    double link_fall;        /* of the rate, at least, in one step: less than the link's rate may have arrived */
    double link_rise, link_rise_slowly;     /* ratio of one step */
    double link_near_least, link_near_most; /* of the link's rate when it was full: there it rises slowly */
    double link_least_bits;                 /* bit/s */
    double link_least_share;                /* of -wire, at least: delays can be forged */

    /* ---- Frames ---- */
    int64_t whole_every;        /* from one whole picture to the next */
    int64_t renewal_in_loss;    /* from one regular renewal to the next, while a receiver that reports loses packets */
    double whole_share;         /* of the bytes in the bucket, for one: it waits 0.1 s before a link of this rate */
    unsigned skip_frames;       /* most frames that are left out in sequence for repair or in an outage, */
    double skip_frames_most;    /* most of them at once, */
    double skip_share;          /* and of all frames on average */
    unsigned outage_packets;    /* lost in sequence, after which most frames are left out */
    unsigned frame_least_bytes; /* less is not worth its headers */
    double frame_least_share;   /* of the rate that frames get, however much repair is wanted: else pictures are bad */
    double frame_least_share_alone; /* the same for a single receiver, while its repair can be paid */
    int64_t packet_gap;             /* between packets, at most */
    unsigned burst_packets;         /* of a frame that go at once: few frames are larger, and 3.6 kB fit each queue */

    /* ---- The number of frames ---- */
    unsigned rate_every_most; /* each frame of this number is sent, at least */
    double rate_fair_share;   /* of the rate that a frame takes at least, else fewer frames are sent */
    unsigned rate_fair_bytes; /* the same, in bytes: of less than this, headers take half and more */
    double rate_loss;         /* below it the number of frames is not reduced */
    double rate_frames;       /* in which the mean is learnt */
    double rate_rise;         /* of the fair size, above which more frames are sent */
    int64_t rate_lower_after; /* from one change to the next */
    int64_t rate_raise_after;
    double repair_kept;        /* of a receiver's bytes for repair, that frames leave */
    int64_t repair_kept_after; /* in which this is reached again */

    /* ---- Repair in advance ---- */
    int64_t stopped;          /* without reports: they have just stopped */
    int64_t silent;           /* without reports: probably an outage in both directions */
    double stopped_rate;      /* share of the rate, then */
    double stopped_repair;    /* share of the repair packets: they are still as long as the larger frames before */
    double advance_base;      /* repair packets for each media packet without loss, */
    double advance_for_loss;  /* times the loss more, */
    double advance_in_runs;   /* more where losses come in runs, */
    double advance_most;      /* and at most */
    unsigned advance_frames;  /* that one covers */
    unsigned advance_whole;   /* each one of this number covers the whole window */
    double repair_size_ratio; /* of a repair packet to a media packet */
    unsigned step_packets;    /* media packets, after which one more repair packet goes */

    /* ---- Missing packets ---- */
    int64_t jitter;        /* that does not count as a loss, */
    int64_t margin_period; /* in which the longest round trip is looked for: later packets are late, not lost */
    double margin_loss;    /* above which packets are given less time: */
    int64_t margin_most;
    int64_t margin_most_narrow; /* the same on a narrow link: */
    int64_t narrow;             /* the mean round trip is longer by this than the shortest one */
    int64_t late;               /* since the oldest missing frame was handed over */
    int64_t very_late;
    double late_sure;      /* standard deviations that are added for frames that are late, */
    double very_late_sure; /* and very late */
    unsigned many_packets; /* from this number of missing ones on, some are lost again */
    double loss_most;      /* a higher loss counts as this */
    int64_t short_trip;    /* there and back */
    int64_t trip_period;   /* in which the shortest round trip is looked for */
    int64_t queue;         /* that packets wait before the link, above which it is full */
    int64_t queue_period;  /* at most two frames */
    int64_t queue_late;    /* the last packet's delay, above which a shorter period is enough: */
    int64_t queue_period_late;
    double in_runs_packets;    /* mean length of runs; above it, losses certainly come in runs */
    unsigned run_packets_most; /* a longer run is an outage, which ends by itself */
    unsigned quiet_packets;    /* lost in sequence, after which nothing seems to get through */
    unsigned quiet_packets_in_runs;
    unsigned probes;            /* sent for each report then; */
    unsigned probes_many;       /* the same for several receivers, whose frames need the rate */
    unsigned probes_unanswered; /* after which the receiver does not seem to know them */
} tuning = {
    .bucket = 300 * MS,
    .fill_first = 0.5, /* with 0.5 % less than the rate the mean of 30 s is never more */
    .fill = 0.85,
    .fill_in_runs_many = 0.5,
    .fill_one_way = 0.5,
    .fill_frames_alone = 20,
    .fill_frames = 4,
    .fill_frames_in_runs = 12,
    .fill_reserve = 0.1,
    .runs_packets = 1.4,
    .shares_kept = 1 - 1.0 / 75,
    .link_full = 50 * MS,
    .link_full_now = 65 * MS,
    .link_full_more = 25 * MS,
    .link_full_share = 0.25,
    .link_full_after = 150 * MS,
    .link_held_most = 300 * MS,
    .link_held_apart = SECOND,
    .link_step = 100 * MS,
    .link_bucket = 80 * MS,
    .link_drain = 0.85,
    .link_fall = 0.5,
    .link_rise = 1.15,
    .link_rise_slowly = 1.05,
    .link_near_least = 0.8,
    .link_near_most = 1.1,
    .link_least_bits = 50e3,
    .link_least_share = 0.3,
    .whole_every = 4 * SECOND,
    .renewal_in_loss = 20 * SECOND,
    .whole_share = 0.35,
    .skip_frames = 2,
    .skip_frames_most = 40,
    .skip_share = 0.3,
    .outage_packets = 80,
    .frame_least_bytes = 100,
    .frame_least_share = 0.30,
    .frame_least_share_alone = 0.45,
    .packet_gap = MS,
    .burst_packets = 3,
    .rate_every_most = 3,
    .rate_fair_share = 0.28,
    .rate_fair_bytes = 130,
    .rate_loss = 0.2,
    .rate_frames = 25,
    .rate_rise = 1.3,
    .rate_lower_after = SECOND,
    .rate_raise_after = 3 * SECOND,
    .repair_kept = 0.5,
    .repair_kept_after = 4 * SECOND,
    .stopped = 200 * MS,
    .silent = 300 * MS,
    .stopped_rate = 0.5,
    .stopped_repair = 0.85,
    .advance_base = 0.35,
    .advance_for_loss = 5,
    .advance_in_runs = 0.6,
    .advance_most = 2.5,
    .advance_frames = 8,
    .advance_whole = 3,
    .repair_size_ratio = 1.1,
    .step_packets = 64,
    .jitter = 3 * MS,
    .margin_period = SECOND,
    .margin_loss = 0.05,
    .margin_most = 10 * MS,
    .margin_most_narrow = 2 * MS,
    .narrow = 12 * MS,
    .late = 60 * MS,
    .very_late = 80 * MS,
    .late_sure = 1.0,
    .very_late_sure = 2.0,
    .many_packets = 4,
    .loss_most = 0.5,
    .short_trip = 12 * MS,
    .trip_period = 5 * SECOND,
    .queue = 20 * MS,
    .queue_period = 80 * MS,
    .queue_late = 30 * MS,
    .queue_period_late = 40 * MS,
    .in_runs_packets = 2.0,
    .run_packets_most = 16,
    .quiet_packets = 8,
    .quiet_packets_in_runs = 1,
    .probes = 4,
    .probes_many = 3,
    .probes_unanswered = 60,
};

#endif
