/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Announcements of streams (SAP, RFC 2974): messages with a stream's description (SDP), sent to separate multicast
 * groups. No sockets, no clock. The input is not trusted.
 */
#ifndef DDXVIDEO_SAP_H
#define DDXVIDEO_SAP_H

#include "network.h"

#define SAP_PORT 9875
#define SAP_MAX 1400 /* bytes of our messages; the RFC recommends less than 1024 */

struct sap {
    bool deletion;
    uint16_t hash;                 /* identifies, with the origin, this version of the announcement */
    struct network_address origin; /* the announcing machine; its port has no meaning */
    const uint8_t *text;           /* SDP, not terminated; of a deletion, its o= line, or nothing */
    size_t size;
};

/* Write a message to to[SAP_MAX]. Returns its size; 0: too large. */
size_t sap_write(const struct sap *sap, uint8_t *to);

/*
 * Reads a message; sap->text points into the data. False if there is no description to read: another version,
 * encryption or compression, a type other than application/sdp, an announcement without text, zero bytes in the text,
 * no origin (0.0.0.0). The authentication is skipped, not checked.
 */
bool sap_parse(const uint8_t *data, size_t size, struct sap *sap);

/* The hash of a description: two descriptions very likely have different ones. Never 0. */
uint16_t sap_hash(const uint8_t *text, size_t size);

/* The address for announcements of this group's streams: the group of the same scope, with SAP_PORT. */
void sap_group(const struct network_address *stream, struct network_address *group);

#endif
