/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Sends reports on the followed source to the address from which its media packets come, so that they pass a router
 * with address translation. Nothing waits.
 */
#ifndef DDXVIDEO_ANSWER_H
#define DDXVIDEO_ANSWER_H

#include "stream_rx.h"
#include "network.h"
#include "reporter.h"
#include "secure.h"

enum answer_count { ANSWER_REPORTS, ANSWER_LOST, ANSWER_COUNTS };
#define ANSWER_NAMES "reports", "reports_lost"

struct answer {
    bool silent;           /* nothing is sent */
    uint32_t ssrc;         /* of this receiver */
    struct secure *secure; /* NULL: reports are not encrypted */
    uint64_t count[ANSWER_COUNTS];
    /* state: */
    bool known; /* the source is our sender's, and has this address: */
    struct sockaddr_storage to;
    struct reporter reporter; /* of the source with this SSRC */
};

/* Note a media packet of the followed source that is neither late nor a duplicate. */
void answer_media(struct answer *answer, const uint8_t *data, size_t size, const struct sockaddr_storage *from,
                  int64_t now);

/* Note one of its repair packets. */
void answer_repair(struct answer *answer, const uint8_t *data, size_t size, int64_t now);

/* Send a report, if one is due, through this socket. `refresh`: also request a renewal of the picture. */
void answer_send(struct answer *answer, int fd, const struct restore *restore, bool refresh, int64_t now);

/* The time at which a report is due without a new packet; INT64_MAX: never. */
int64_t answer_deadline(const struct answer *answer, const struct restore *restore);

#endif
