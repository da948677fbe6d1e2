/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Reads an announced description (SDP, RFC 4566): its first video stream. The text is not trusted. */
#ifndef DDXVIDEO_SDP_READ_H
#define DDXVIDEO_SDP_READ_H

#include "network.h"

struct sdp_stream {
    char name[64];  /* of the session; printable ASCII, other characters became '?' */
    char codec[16]; /* such as H264; printable ASCII */
    struct network_address address;
};

/* False if the text has no video stream with address and port. */
bool sdp_read(const uint8_t *text, size_t size, struct sdp_stream *stream);

#endif
