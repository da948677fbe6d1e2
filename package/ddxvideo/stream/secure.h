/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Encryption of a stream: SRTP and SRTCP (RFC 3711), AES_CM_128_HMAC_SHA1_80, with libsrtp2. All packets of a stream,
 * including repair packets and reports, use the key of one key file (key_file.h). In a build without libsrtp2,
 * secure_open() fails with an error text.
 *
 * Any SSRC is accepted. Its state is kept only after one of its packets was authenticated: forged packets cost time
 * (about 6 us on a 3 GHz core), but no memory. In each direction, the last SECURE_PEERS sources are kept. A restarted
 * sender or receiver has a new random SSRC.
 *
 * Sequence wrap: the rollover counter is in the packets, see below. A receiver may start at any time, and may
 * lose contact for any time: it continues with the next packet that has the counter. A counter is accepted only in a
 * packet that is authentic with it, and for a known source only if it is not a step back. A source without counters
 * (another program) is received after its first wrap only if it was received before, as in RFC 3711.
 *
 * Replay: each packet of a source is accepted once, in any order within SECURE_WINDOW packets. A key alone cannot
 * prevent that recorded packets of a source that is unknown to a receiver (an earlier run of the sender, or one before
 * the receiver's start) are accepted. A new key ends that. Two sources of one key must never have the same SSRC, since
 * they would be encrypted with the same key stream; random SSRCs collide once in 2^32 / n for the n-th start. So give
 * each stream its own key, and replace it after some thousand starts.
 *
 * The sender protects a packet once and sends the result to each receiver. A packet that is protected twice is
 * refused.
 *
 * The four functions (protect and unprotect, of RTP and of RTCP) share no state: each may be called by its own thread.
 * Only secure_open() can block, since it reads a file.
 */
#ifndef DDXVIDEO_SECURE_H
#define DDXVIDEO_SECURE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "key_file.h"

/*
 * ---- The rollover counter (RFC 3711: how often the 16-bit sequence number has wrapped), sent unencrypted ----
 *
 * A receiver needs the counter to check and decrypt a packet, and standard SRTP does not send it: a receiver that
 * starts after the first wrap (44 minutes at 25 packets a second), or receives nothing for half a wrap, would refuse
 * every packet. So each packet whose sequence number is a multiple of ROLLOVER_EVERY has the counter in its header
 * extension (RFC 8285, one-byte form), which SRTP authenticates but does not encrypt:
 *
 *   id 4, 3 bytes   urn:ddxvideo:rollover: the counter's low 24 bits, big endian; enough for years
 *
 * It is always the first element, and id 4 has no other use. A packet with an extension becomes 4 bytes longer, one
 * without 8 bytes. The receiver removes the element, so that repair packets cover the same bytes on both sides.
 *
 * Alternatives are worse. A new SSRC before each wrap would restart repair, reports and players every 44 minutes. RFC
 * 4771 puts the counter into the authentication tag, where ordinary SRTP players refuse the packet; they skip an
 * unknown element. Trying all counters would let forged packets cost unlimited time.
 */

#define ROLLOVER_URI "urn:ddxvideo:rollover"
#define ROLLOVER_ID 4
#define ROLLOVER_EVERY 4  /* packets: at 25 packets a second and without loss, a new receiver waits at most 160 ms */
#define ROLLOVER_GROWTH 8 /* bytes that a packet grows by, at most */

/* Put the counter into an RTP packet, which has room for ROLLOVER_GROWTH more bytes. Returns its new size; unchanged if
 * this is not an RTP packet, or its extension is empty or has another form. */
size_t rollover_put(uint8_t *packet, size_t size, uint32_t counter);

/* Whether the packet, encrypted or not, has the counter. */
bool rollover_get(const uint8_t *packet, size_t size, uint32_t *counter);

/* Undo rollover_put(). Returns the packet's new size; unchanged if it has no counter. */
size_t rollover_take(uint8_t *packet, size_t size);

/* ---- Encryption ---- */

#define SECURE_GROWTH (10 + ROLLOVER_GROWTH) /* bytes that an RTP packet grows by, at most; 10 without the counter */
#define SECURE_GROWTH_MEAN (10 + ROLLOVER_GROWTH / ROLLOVER_EVERY) /* mean of consecutive packets, at most */
#define SECURE_REPORT_GROWTH 14                                    /* bytes that an RTCP packet grows by */
#define SECURE_ROOM (144 + ROLLOVER_GROWTH)                        /* bytes after a packet that libsrtp2 requires */
#define SECURE_PACKET_MAX 2048                                     /* bytes of a packet, without the room */
#define SECURE_PEERS 16                                            /* sources in each direction, each an SSRC */
#define SECURE_WINDOW 512                                          /* packets */
#define SECURE_SDP_MAX 200

/* Counts of received packets: all = good + refused + repeated. */
struct secure_count {
    uint64_t good;
    uint64_t refused;  /* not encrypted with this key, damaged, or not a packet */
    uint64_t repeated; /* received before, or older than the window */
};

struct secure;

/* Read the key. NULL, with one line in error[KEY_FILE_ERROR_MAX], if that fails. Call it in one thread at a time. */
struct secure *secure_open(const char *path, char *error);

/* NULL is allowed. */
void secure_close(struct secure *secure);

/*
 * Encrypt an RTP packet in place; packet[SECURE_PACKET_MAX + SECURE_ROOM] is aligned to 4 bytes, `size` is the old and
 * the new size. 0, or an error, after which the packet must not be sent: -EINVAL (not an RTP packet, or too long),
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
 * Write the lines of an SDP file to text[SECURE_SDP_MAX]. Returns their length. They have the key (a=crypto, RFC 4568):
 * only for a file of mode 600, never for SAP. The media line needs RTP/SAVP instead of RTP/AVP.
 */
size_t secure_sdp(const struct secure *secure, char *text);

#endif
