/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The encoded frames as MPEG-TS over RTP (payload type 33, RFC 2250) as well, for players that know nothing else; the
 * same bits, not encoded again. It goes to the stream's receivers at a port of its own, with its own SSRC and sequence,
 * and takes its bytes from the stream's budget.
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
    uint64_t lost;       /* packets that a receiver was not sent: the kernel or the budget refused them */
};

/* Whether this program and its FFmpeg support MPEG-TS. */
bool ts_is_possible(void);

/* `post`: of the stream, started. `name`: what players show. 0, or a negative AVERROR. Close it in any case. */
int ts_open(struct ts *ts, struct post *post, enum rtp_type type, const char *name);
void ts_close(struct ts *ts);

/* Send a frame, captured at `time` (ns). Never waits. Nothing is sent if it is not open, or the muxer refuses it. */
void ts_send(struct ts *ts, const uint8_t *data, size_t size, int64_t time);

#endif
