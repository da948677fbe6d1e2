/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Descriptions of streams (SDP, RFC 4566), for players in a file, and their announcements (SAP, RFC 2974). */
#ifndef DDXVIDEO_SDP_H
#define DDXVIDEO_SDP_H

#include <stddef.h>
#include <stdint.h>

#include "network.h"
#include "rtp.h"

/* ---- Descriptions ---- */

struct sdp {
    const char *name; /* of the session */
    struct network_address address;
    int ttl;              /* for IPv4 groups; an IPv6 description has none */
    int type;             /* enum rtp_type, or RTP_TS, for which `frame` is not needed */
    const uint8_t *frame; /* the stream's first frame, with its parameter sets or headers */
    size_t size;
    double rate;        /* frames per second */
    const char *crypto; /* lines with the key of an encrypted stream, or NULL */
};

#define SDP_MAX 4096

/* Write the text to text[SDP_MAX]. Returns its length; 0 if the frame has no parameters. */
size_t sdp_write(const struct sdp *sdp, char *text);

/* The same, into a file, which is replaced as a whole. With a key it has mode 600. 0 or -errno (-EBADMSG: no
 * parameters). */
int sdp_save(const struct sdp *sdp, const char *path);

/* The first video stream of an announced description, which is not trusted. */
struct sdp_stream {
    char name[64];  /* of the session; printable ASCII, other characters became '?' */
    char codec[16]; /* such as H264; printable ASCII */
    struct network_address address;
};

/* False if the text has no video stream with address and port. */
bool sdp_read(const uint8_t *text, size_t size, struct sdp_stream *stream);

/*
 * ---- Announcements: messages with a stream's description, sent to separate multicast groups ----
 *
 * No sockets, no clock. The input is not trusted.
 */

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
