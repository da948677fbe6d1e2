/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * RTP packets (RFC 3550). The packets of our sender describe their frame in a header extension (RFC 8285, one-byte
 * form), which other players ignore. All numbers are big endian.
 *
 *   id 2, 3 bytes  urn:ddxvideo:frame: number of the frame in this stream (16 bits), from 0; whether the stream is
 *                  encrypted (1 bit); how many frames back the repair packets of this sender reach (7 bits), 0 if it
 *                  sends none
 *   id 1, 8 bytes  http://www.webrtc.org/experiments/rtp-hdrext/abs-capture-time: capture time of the frame, NTP
 *   id 3, 8 bytes  urn:ddxvideo:source: number of the write in the store (32 bits), number of the frame in its source's
 *                  count (32 bits)
 *
 * Every packet has id 2, so that each packet names its frame: 8 bytes with the extension's own header. The first packet
 * of a frame has all three: 28 bytes.
 */
#ifndef DDXVIDEO_RTP_H
#define DDXVIDEO_RTP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define RTP_PACKET_MAX 1200   /* bytes of a packet that we send, with its header */
#define RTP_DATAGRAM_MAX 2048 /* bytes that we accept */
#define RTP_HEADER_MAX 40     /* bytes of the header that we write: of a frame's first packet, */
#define RTP_HEADER_NEXT 20    /* and of its other packets */
#define RTP_WHOLE 800         /* bytes of an encoded frame, up to which it is one packet */
#define RTP_CLOCK 90000       /* Hz, of time stamps of both codecs */

/* Payload of our packets, and by how much that of the first one is smaller, so that all packets have the same size. */
#define RTP_ROOM (RTP_PACKET_MAX - RTP_HEADER_NEXT)
#define RTP_FIRST_LESS (RTP_HEADER_MAX - RTP_HEADER_NEXT)

#define RTP_CAPTURE_URI "http://www.webrtc.org/experiments/rtp-hdrext/abs-capture-time"
#define RTP_FRAME_URI "urn:ddxvideo:frame"
#define RTP_SOURCE_URI "urn:ddxvideo:source"

/* Payload types; they also identify the codec. */
enum rtp_type { RTP_H264 = 96, RTP_MPEG4 = 97 };
#define RTP_TS 33 /* MPEG-TS, RFC 2250: for other players */

struct rtp_frame {
    uint16_t count; /* of frames in this stream */
    bool encrypted; /* by SRTP: without its key the payload cannot be read */
    uint8_t window; /* frames that repair packets reach back, 127 at most; 0: there are none */
    /* in a frame's first packet: */
    int64_t capture;   /* CLOCK_REALTIME, ns */
    uint32_t sequence; /* the low bits of the sequence in the store */
    uint32_t number;
};

struct rtp_packet {
    uint8_t type;
    bool marker; /* the last one of its frame */
    uint16_t sequence;
    uint32_t time;
    uint32_t ssrc;
    bool has_count;  /* frame.count, .encrypted and .window, which only our sender writes */
    bool has_source; /* frame.capture, .sequence and .number as well: the first packet of a frame */
    struct rtp_frame frame;
    const uint8_t *payload; /* rtp_parse() only */
    size_t size;
};

/* Whether sequence number a comes after b. */
static inline bool rtp_after(uint16_t a, uint16_t b) {
    return (int16_t)(a - b) > 0;
}

/* A sequence number from far away is accepted when the next packet has the following number. */
struct rtp_stranger {
    bool there;
    uint16_t next; /* the number that would confirm the last one from far away */
};

/* Whether a number from far away is accepted. */
static inline bool rtp_is_confirmed(struct rtp_stranger *stranger, uint16_t sequence) {
    bool confirmed = stranger->there && stranger->next == sequence;

    stranger->next = (uint16_t)(sequence + 1);
    stranger->there = true;
    return confirmed;
}

/* A time in units of RTP's clock. */
static inline uint32_t rtp_time(int64_t ns) {
    return (uint32_t)(uint64_t)(ns / 100000 * 9 + ns % 100000 * 9 / 100000);
}

/*
 * Write the header. Returns its length: RTP_HEADER_MAX with has_source (and has_count, without which it has no
 * meaning), RTP_HEADER_NEXT with has_count alone, 12 bytes without an extension.
 */
size_t rtp_write(uint8_t *to, const struct rtp_packet *packet);

/* False if this is not an RTP packet with a payload. packet->payload points into the data. */
bool rtp_parse(const uint8_t *data, size_t size, struct rtp_packet *packet);

#endif
