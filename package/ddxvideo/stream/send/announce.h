/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The sender's announcements (SAP): each description of a stream goes to the announcements' group of the same scope as
 * the stream's group, every ANNOUNCE_INTERVAL_NS, and is deleted at the end. Nothing waits: an announcement that the
 * stream's budget or the kernel refuses is left out, and the next one follows after ANNOUNCE_RETRY_NS. Streams
 * without a group are not announced.
 */
#ifndef DDXVIDEO_ANNOUNCE_H
#define DDXVIDEO_ANNOUNCE_H

#include "post.h"
#include "sdp.h"

/*
 * RFC 2974 allows 4000 bit/s for all announcements of a group, and at most one each 300 s. A player should find a robot
 * sooner; two announcements of 500 bytes each 5 s take 1600 bit/s.
 */
#define ANNOUNCE_INTERVAL_NS INT64_C(5000000000)
#define ANNOUNCE_RETRY_NS INT64_C(500000000)
#define ANNOUNCE_STREAMS 2

struct announce_stream {
    uint32_t session, version; /* of the o= line */
    char body[SDP_MAX];        /* the description from its s= line on; empty: none */
    bool announced;            /* set from the announced description: */
    struct network_address origin;
    uint16_t hash;
    char line[160]; /* its o= line */
};

struct announce {
    bool off; /* set for encrypted streams */
    int64_t due;
    struct announce_stream stream[ANNOUNCE_STREAMS];
};

/* Set the description of stream `which`, from sdp_write(). `session`: a number of this run. */
void announce_describe(struct announce *announce, unsigned which, uint32_t session, const char *sdp);

/* Send announcements that are due. Call it often. The bytes are taken from the stream's budget, `post`. */
void announce_tick(struct announce *announce, struct post *post, int64_t now);

/* Delete the announcements. */
void announce_end(struct announce *announce, struct post *post);

#endif
