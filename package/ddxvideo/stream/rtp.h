/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * RTP packets (RFC 3550), and what ours say of the frame they belong to, in a header extension (RFC 8285, one-byte
 * form): players that do not know it ignore it.
 *
 *   id 1, 8 bytes   http://www.webrtc.org/experiments/rtp-hdrext/abs-capture-time: when the frame was captured, NTP
 *   id 2, 10 bytes  urn:ddxvideo:frame: number of the write in the store (32 bits), number of the frame in its source's
 *                   count (32 bits), number of the frame in this stream (16 bits), from 0; big endian
 *
 * Each packet has both, so that any of them tells which frame it is of.
 */
#ifndef DDXVIDEO_RTP_H
#define DDXVIDEO_RTP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define RTP_PACKET_MAX 1200   /* bytes of a packet of ours, header included */
#define RTP_DATAGRAM_MAX 2048 /* bytes that we accept */
#define RTP_HEADER_MAX 40     /* bytes of the header that we write */
#define RTP_CLOCK 90000       /* Hz, of time stamps of both codecs */

#define RTP_CAPTURE_URI "http://www.webrtc.org/experiments/rtp-hdrext/abs-capture-time"
#define RTP_FRAME_URI "urn:ddxvideo:frame"

/* Payload types, which also tell the codec. */
enum rtp_type { RTP_H264 = 96, RTP_MPEG4 = 97 };

struct rtp_frame {
    int64_t capture;   /* CLOCK_REALTIME, ns */
    uint32_t sequence; /* the low bits of the number of the write */
    uint32_t number;
    uint16_t count;
};

struct rtp_packet {
    uint8_t type;
    bool marker; /* the last one of its frame */
    uint16_t sequence;
    uint32_t time;
    uint32_t ssrc;
    bool has_frame; /* the sender is one of ours: */
    struct rtp_frame frame;
    const uint8_t *payload; /* rtp_parse() only */
    size_t size;
};

/* Whether sequence number a comes after b. */
static inline bool rtp_after(uint16_t a, uint16_t b) {
    return (int16_t)(a - b) > 0;
}

/* A time on RTP's clock. */
static inline uint32_t rtp_time(int64_t ns) {
    return (uint32_t)(uint64_t)(ns / 100000 * 9 + ns % 100000 * 9 / 100000);
}

/* The header, with the extension; returns its length, at most RTP_HEADER_MAX. */
size_t rtp_write(uint8_t *to, const struct rtp_packet *packet);

/* False if this is no RTP packet with a payload. packet->payload points into the data. */
bool rtp_parse(const uint8_t *data, size_t size, struct rtp_packet *packet);

#endif
