/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Checks datagrams before stream_rx.h gets them. With a key: packets pass that the key authenticates, decrypted.
 * Without a key: packets that are not encrypted (rtp.h, frame.encrypted), because a decoder cannot use an encrypted
 * payload. All others are refused and counted, and a line for each source has the reason. Forged packets with the SSRC
 * of a stream on display do not stop its repair packets.
 *
 * No sockets, no clock. Nothing blocks. Fixed memory.
 */
#ifndef DDXVIDEO_GUARD_H
#define DDXVIDEO_GUARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "secure.h"

#define GUARD_SOURCES 4
#define GUARD_DOUBT 16                      /* refused packets of a source until it is reported */
#define GUARD_QUIET_NS INT64_C(10000000000) /* between two lines */
#define GUARD_TEXT_MAX 400

/* Datagrams that came to the two ports = received + repair_received of struct stream_rx + these. */
enum guard_count {
    GUARD_REFUSED,  /* encrypted with another key, not encrypted, encrypted and there is no key, changed, forged */
    GUARD_REPEATED, /* with a key: their sequence number came before */
    GUARD_COUNTS
};
#define GUARD_NAMES "refused", "repeated"

struct guard_source {
    uint32_t ssrc;
    uint64_t used;  /* time of the last use, by `used` of struct guard; 0: free */
    bool good;      /* the key fits this source */
    bool encrypted; /* by its newest refused packet */
    bool said;
    unsigned refused; /* packets */
};

struct guard {
    const char *path;      /* of the key file, or NULL */
    struct secure *secure; /* the key, or NULL */
    uint64_t count[GUARD_COUNTS];
    bool shows; /* a stream is on display: */
    uint32_t shown;
    /* state: */
    uint64_t used;
    bool has_said;
    int64_t said; /* time of the last line */
    struct guard_source source[GUARD_SOURCES];
};

/* Mark the stream with this SSRC as on display: its packets were passed on, and struct stream_rx follows it. */
void guard_show(struct guard *guard, uint32_t ssrc);

/*
 * Whether a datagram of the port for media packets, or for repair packets, passes. It is decrypted in place;
 * data[SECURE_PACKET_MAX + SECURE_ROOM] is aligned to 4 bytes, `size` is the old and the new size and may be more than
 * SECURE_PACKET_MAX for a datagram that was cut off.
 */
bool guard_media(struct guard *guard, uint8_t *data, size_t *size);
bool guard_repair(struct guard *guard, uint8_t *data, size_t *size);

/* Write a line about a refused source to text[GUARD_TEXT_MAX]. False: there is none, or the last one was less than
 * GUARD_QUIET_NS ago. */
bool guard_says(struct guard *guard, int64_t now, char *text);

#endif
