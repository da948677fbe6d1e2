/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The sender's announcements (SAP): each description of a stream goes to the announcements' group of the same scope as
 * the stream's group, every ANNOUNCE_INTERVAL, and is taken back at the end. Nothing waits: an announcement that the
 * stream's budget or the kernel does not take at once is left out, and the next one follows after ANNOUNCE_RETRY.
 * Streams to single receivers alone are not announced.
 */
#ifndef DDXVIDEO_ANNOUNCE_H
#define DDXVIDEO_ANNOUNCE_H

#include "post.h"
#include "sap.h"
#include "sdp.h"

/*
 * RFC 2974 lets all announcements of a group take 4000 bit/s, and lets none come more often than every 300 s. A player
 * that is opened should not take so long to find a robot; two announcements of 500 bytes each 5 s take 1600 bit/s.
 */
#define ANNOUNCE_INTERVAL INT64_C(5000000000) /* ns */
#define ANNOUNCE_RETRY INT64_C(500000000)     /* ns */
#define ANNOUNCE_STREAMS 2

struct announce_stream {
    uint32_t session, version; /* of the o= line */
    char body[SDP_MAX];        /* the description from its s= line on; empty: none */
    bool announced;            /* made from it: */
    struct network_address origin;
    uint16_t hash;
    char line[160]; /* its o= line */
};

struct announce {
    bool off; /* set for encrypted streams */
    int64_t due;
    struct announce_stream stream[ANNOUNCE_STREAMS];
};

/* Takes over a description, as sdp_write() makes it, of stream `which`; `session`: a number for each run. */
void announce_describe(struct announce *announce, unsigned which, uint32_t session, const char *sdp);

/* Sends what is due; call it often. Each packet takes its bytes from the stream's budget, `post`. */
void announce_tick(struct announce *announce, struct post *post, int64_t now);

/* Takes the announcements back. */
void announce_end(struct announce *announce, struct post *post);

#endif
