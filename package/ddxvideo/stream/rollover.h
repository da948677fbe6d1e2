/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The rollover counter of an encrypted stream (RFC 3711: how often its 16-bit sequence number has wrapped), sent
 * unencrypted.
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
#ifndef DDXVIDEO_ROLLOVER_H
#define DDXVIDEO_ROLLOVER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

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

#endif
