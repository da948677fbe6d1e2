/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The receivers that report, and how many repair packets they need together: the one that needs most decides, since
 * each repair packet serves all. No sockets, no clock.
 *
 * Nothing here is trusted. A report changes how the budget is used, never its size. At most FEEDBACK_REPORTERS
 * reporters are known; one that has an address to itself takes the place of one that shares an address with others,
 * so that a single host cannot fill the table. Each reporter, and all together, have a bucket of their own for the
 * repair packets that they cause: a receiver that loses almost everything, or claims to, leaves enough for the
 * pictures and for the others.
 */
#ifndef DDXVIDEO_FEEDBACK_H
#define DDXVIDEO_FEEDBACK_H

#include "budget.h"
#include "deficit.h"

#define FEEDBACK_REPORTERS 8
#define FEEDBACK_GONE INT64_C(1000000000) /* ns without a report after which a reporter is forgotten */
#define FEEDBACK_HOPELESS 0.6             /* loss above which a reporter gets less */

/* RECEIVED is the sum of the others. */
enum feedback_count {
    FEEDBACK_RECEIVED,
    FEEDBACK_USED,
    FEEDBACK_GARBAGE, /* no report, about another stream, or about packets that were never sent */
    FEEDBACK_STALE,   /* older than one that was used, or about packets that are forgotten */
    FEEDBACK_FLOOD,   /* more than a receiver sends, or no room for this reporter */
    FEEDBACK_COUNTS
};

struct feedback_reporter {
    bool used;
    uint32_t ssrc;
    uint64_t address; /* a hash */
    struct deficit deficit;
    struct budget reports; /* a token for each report that is read */
    struct budget claims;  /* bytes of repair packets that it may cause */
    struct budget hopeless; /* the same, when it loses almost everything */
};

struct feedback {
    uint32_t media; /* SSRC */
    int64_t rate;   /* bit/s of the stream */
    double loss;    /* the worst of the receivers that reported: the last one or mean_loss, whichever is higher */
    double mean_loss; /* of the last ten seconds: in bursts, the loss of two seconds is anything from 0 to 50 % */
    bool in_runs;   /* one of these has losses that come in runs */
    int64_t heard;  /* when the last report came; INT64_MIN if none did */
    uint64_t count[FEEDBACK_COUNTS];
    struct budget claims; /* of all together */
    struct history sent, repairs;
    struct feedback_reporter reporter[FEEDBACK_REPORTERS];
};

void feedback_init(struct feedback *feedback, uint32_t media, int64_t rate, int64_t now);

/* A datagram came from an address (its hash). True if it asks for a refresh of the picture. */
bool feedback_report(struct feedback *feedback, int64_t now, const uint8_t *data, size_t size, uint64_t address);

/* ns since the last report that was used; INT64_MAX if there was none. */
int64_t feedback_silence(const struct feedback *feedback, int64_t now);

/* How many repair packets are wanted now, and the oldest media packet that they have to cover. */
unsigned feedback_wanted(struct feedback *feedback, int64_t now, uint32_t *first);

/* Whether losses of a receiver come in runs. */
bool feedback_has_runs(const struct feedback *feedback, int64_t now);

/* Whether exactly one receiver reports. */
bool feedback_is_single(const struct feedback *feedback, int64_t now);

/* A repair packet of that many bytes was sent because of feedback_wanted(). */
void feedback_paid(struct feedback *feedback, int64_t now, size_t bytes);

#endif
