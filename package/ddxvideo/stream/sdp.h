/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Descriptions of streams (SDP, RFC 4566): for players in a file, and announced (sap.h). */
#ifndef DDXVIDEO_SDP_H
#define DDXVIDEO_SDP_H

#include <stddef.h>
#include <stdint.h>

#include "network.h"
#include "rtp.h"

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

/* What an announced description, which is not trusted, says of its first video stream. */
struct sdp_stream {
    char name[64];  /* of the session; printable ASCII, other characters became '?' */
    char codec[16]; /* such as H264; printable ASCII */
    struct network_address address;
};

/* False if the text has no video stream with address and port. */
bool sdp_read(const uint8_t *text, size_t size, struct sdp_stream *stream);

#endif
