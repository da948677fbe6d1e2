/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Keeps the receivers that report, and the number of repair packets that they need: the highest of their numbers, since
 * each repair packet serves all. No sockets, no clock.
 *
 * Reports are not trusted. They change the use of the budget, never its size. At most FEEDBACK_REPORTERS reporters are
 * kept; a reporter with an address of its own takes the place of one that shares an address with others, so that a
 * single host cannot fill the table, and one that lacks packets the place of one that lost nothing for
 * FEEDBACK_CALM_NS. Reporters without losses do not stop repair in advance for receivers that were lossy when they fell
 * silent. Each reporter, and all together, have a bucket for the repair packets that they cause, of half the rate for
 * each one: a receiver that loses almost everything, or claims to, leaves enough for the pictures and for the others.
 */
#ifndef DDXVIDEO_FEEDBACK_H
#define DDXVIDEO_FEEDBACK_H

#include "budget.h"
#include "deficit.h"

#define FEEDBACK_REPORTERS 8
#define FEEDBACK_GONE_NS INT64_C(1000000000)  /* without a report after which a reporter is forgotten */
#define FEEDBACK_CALM_NS INT64_C(10000000000) /* without a loss after which a reporter counts as free of losses */
#define FEEDBACK_KEPT_NS INT64_C(60000000000) /* for which a lossy reporter that fell silent is remembered */
#define FEEDBACK_HOPELESS 0.75                /* loss above which a reporter gets less */

/* RECEIVED is the sum of the others. */
enum feedback_count {
    FEEDBACK_RECEIVED,
    FEEDBACK_USED,
    FEEDBACK_GARBAGE, /* not a report, about another stream, or about packets that were never sent */
    FEEDBACK_STALE,   /* older than a used report, or about forgotten packets */
    FEEDBACK_FLOOD,   /* more than a receiver sends, or no room for this reporter */
    FEEDBACK_COUNTS
};

struct feedback_reporter {
    bool used;
    uint32_t ssrc;
    uint64_t address;     /* a hash */
    int64_t begun, lossy; /* time of the first report; of the last one with a loss, `begun` - FEEDBACK_CALM_NS: none */
    struct deficit deficit;
    struct budget reports;  /* a token for each report to read */
    struct budget claims;   /* bytes of repair packets that it may cause */
    struct budget hopeless; /* the same, when it loses almost everything */
};

struct feedback {
    uint32_t media;   /* SSRC */
    int64_t rate;     /* bit/s of the stream */
    double loss;      /* of the worst receiver: the last reported one or mean_loss, the higher one */
    double mean_loss; /* of the last ten seconds: in bursts, that of two seconds varies from 0 to 50 % */
    bool in_runs;     /* losses of one of these come in runs */
    int64_t heard;    /* time of the last report; INT64_MIN: none yet */
    uint64_t count[FEEDBACK_COUNTS];
    bool spare;           /* set by the caller: a part of the rate is left over */
    struct budget claims; /* of all together */
    struct budget probes; /* bytes of probes, of all together */
    struct history sent, repairs;
    struct feedback_reporter reporter[FEEDBACK_REPORTERS];
};

void feedback_init(struct feedback *feedback, uint32_t media, int64_t rate, int64_t now);

/* Use a datagram from this address (a hash). True if it requests a refresh of the picture. */
bool feedback_report(struct feedback *feedback, int64_t now, const uint8_t *data, size_t size, uint64_t address);

/* ns since the last used report, of those receivers that have losses, if there are any; INT64_MAX: none yet. */
int64_t feedback_silence(const struct feedback *feedback, int64_t now);

/* Whether receivers report, and none of them has losses. */
bool feedback_is_calm(const struct feedback *feedback, int64_t now);

/* Number of repair packets that are wanted now; *first: the oldest media packet that they must cover. */
unsigned feedback_wanted(struct feedback *feedback, int64_t now, uint32_t *first);

/* The loss of the worst receiver that reports, 0 to 1, and the longest mean of lost packets in sequence; 0: none. */
void feedback_losses(const struct feedback *feedback, int64_t now, double *loss, double *run);

/* The lowest loss of the receivers that report and do not lose almost everything; 0: there is none. A forged reporter
 * that claims no loss, or nearly nothing else, does not raise it. */
double feedback_least_loss(const struct feedback *feedback, int64_t now);

/* bit/s of repair that each of these receivers may cause if half of its bytes for repair are to be left in four
 * seconds; INFINITY: there is none. */
double feedback_repair_rate(struct feedback *feedback, int64_t now);

/* The receiver that reports the shortest queue before the link; NULL if none reports. */
const struct deficit *feedback_nearest(const struct feedback *feedback, int64_t now);

/* The receiver that reports, if it is only one; else NULL. */
const struct deficit *feedback_single(const struct feedback *feedback, int64_t now);

/* Whether to send a probe of `bytes` bytes now. */
bool feedback_wants_probe(struct feedback *feedback, int64_t now, size_t bytes);

/* Count a probe that was sent. */
void feedback_probed(struct feedback *feedback, int64_t now, size_t bytes);

/* Count a repair packet of `bytes` bytes that was sent because of feedback_wanted(). */
void feedback_paid(struct feedback *feedback, int64_t now, size_t bytes);

#endif
