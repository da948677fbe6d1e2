/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Sends the encoded frames as MPEG-TS over RTP (payload type 33, RFC 2250) as well, for players that support nothing
 * else; they are not encoded again. The packets go to the stream's receivers, to a separate port, with their own SSRC
 * and sequence; their bytes are taken from the stream's budget.
 */
#ifndef DDXVIDEO_TS_H
#define DDXVIDEO_TS_H

#include "post.h"
#include "rtp.h"

#define TS_PART 1.15 /* bytes for each byte of the stream's media packets, at least */

struct AVFormatContext;
struct AVPacket;

struct ts {
    long port; /* settings; 0: off */
    uint32_t ssrc;
    uint16_t sequence;
    /* state: */
    enum rtp_type type;
    struct post *post;    /* the stream's */
    struct outlet outlet; /* the sender's sockets, which stay the sender's */
    struct AVFormatContext *muxer;
    struct AVPacket *packet;
    int64_t first, last; /* time of the first frame, ns; of the last one, 90 kHz */
    uint32_t time;       /* RTP's, of the frame */
    uint64_t lost;       /* packets that the kernel or the budget refused for a receiver */
};

/* Whether this program and its FFmpeg support MPEG-TS. */
bool ts_is_possible(void);

/* `post`: of the stream, started. `name`: what players show. 0, or a negative AVERROR. Close it in any case. */
int ts_open(struct ts *ts, struct post *post, enum rtp_type type, const char *name);
void ts_close(struct ts *ts);

/* Send a frame, captured at `time` (ns). Never waits. Nothing is sent if it is not open, or the muxer refuses it. */
void ts_send(struct ts *ts, const uint8_t *data, size_t size, int64_t time);

#endif
