/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Encryption of a stream: SRTP and SRTCP (RFC 3711), AES_CM_128_HMAC_SHA1_80, with libsrtp2. All packets of a stream,
 * also repair packets and reports, use the one key of a key file (key_file.h). Where libsrtp2 was missing at build
 * time, secure_open() says so and returns NULL.
 *
 * Any SSRC is accepted. The state of each is kept once a packet of it has been authenticated, never before, so that
 * forged packets cost time (about 6 us on a 3 GHz core), but no memory. Of a direction the SECURE_PEERS sources heard
 * last are kept. A restarted sender or receiver starts with a random SSRC of its own.
 *
 * Sequence wrap: rollover.h says why the rollover counter is in the packets. A receiver may start at any time, and
 * may hear nothing for any time: with the next packet that has the counter it continues. A counter is believed only
 * in a packet that it authenticates, and of a known source only if it leads forward. A source without counters
 * (another program) is received from its first wrap on only if it was received before, as RFC 3711 says.
 *
 * Replay: of each source, SECURE_WINDOW packets back, a packet is accepted once, in any order. What no key alone can
 * prevent: packets that were recorded from a source that a receiver does not know (an earlier run of the sender, or
 * one heard before the receiver started) are accepted. A new key ends that. Two sources of one key must never have
 * the same SSRC, since they would be encrypted with the same key stream; random SSRCs collide once in 2^32 / n for
 * the n-th start. So each stream gets a key of its own, and a new one once in some thousand starts.
 *
 * The sender protects a packet once and sends the result to each receiver. A packet that is protected twice is
 * refused.
 *
 * The four functions (protect and unprotect, of RTP and of RTCP) share no state: each may be called by a thread of its
 * own. Nothing blocks but secure_open(), which reads a file.
 */
#ifndef DDXVIDEO_SECURE_H
#define DDXVIDEO_SECURE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "key_file.h"
#include "rollover.h"

#define SECURE_GROWTH (10 + ROLLOVER_GROWTH) /* bytes that an RTP packet grows by, at most; 10 without the counter */
#define SECURE_GROWTH_MEAN (10 + ROLLOVER_GROWTH / ROLLOVER_EVERY) /* of packets that follow each other, at most */
#define SECURE_REPORT_GROWTH 14              /* bytes that an RTCP packet grows by */
#define SECURE_ROOM (144 + ROLLOVER_GROWTH)  /* bytes of room after a packet that libsrtp2 asks for */
#define SECURE_PACKET_MAX 2048               /* bytes of a packet, without the room */
#define SECURE_PEERS 16                      /* sources of a direction, each an SSRC */
#define SECURE_WINDOW 512                    /* packets */
#define SECURE_SDP_MAX 200

/* Of the packets that came in: all = good + refused + repeated. */
struct secure_count {
    uint64_t good;
    uint64_t refused;  /* not encrypted with this key, damaged, or no packet */
    uint64_t repeated; /* came before, or is older than the window */
};

struct secure;

/* Read the key. NULL, with one line in error[KEY_FILE_ERROR_MAX], if that fails. Not by two threads at once. */
struct secure *secure_open(const char *path, char *error);

/* NULL is allowed. */
void secure_close(struct secure *secure);

/*
 * Encrypt an RTP packet in place; packet[SECURE_PACKET_MAX + SECURE_ROOM] is aligned to 4 bytes, `size` is the old
 * and the new size. 0, or after an error, when the packet must not be sent: -EINVAL (no RTP packet, or too long),
 * -EALREADY (this sequence number has been used), -ENOSPC (more than SECURE_PEERS SSRCs), -ENOMEM.
 */
int secure_protect(struct secure *secure, uint8_t *packet, size_t *size);

/*
 * Check and decrypt an RTP packet in place: the result is what secure_protect() was given. 0, or, counted: -EBADMSG
 * (refused), -EALREADY (repeated). After an error the packet is as it was.
 */
int secure_unprotect(struct secure *secure, uint8_t *packet, size_t *size);

/* The same for RTCP packets. */
int secure_protect_report(struct secure *secure, uint8_t *packet, size_t *size);
int secure_unprotect_report(struct secure *secure, uint8_t *packet, size_t *size);

const struct secure_count *secure_received(const struct secure *secure);
const struct secure_count *secure_received_reports(const struct secure *secure);

/*
 * The lines of an SDP file, into text[SECURE_SDP_MAX]; their length. They have the key (a=crypto, RFC 4568): only for
 * a file of mode 600, never for SAP. The media line says RTP/SAVP instead of RTP/AVP.
 */
size_t secure_sdp(const struct secure *secure, char *text);

#endif
