/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The sender's network thread: sends what stream_tx.h decides when it is due, and reads the reports of receivers. The
 * program's thread hands frames over and never waits for the network.
 */
#ifndef DDXVIDEO_POST_H
#define DDXVIDEO_POST_H

#include <pthread.h>

#include "stream_tx.h"
#include "outlet.h"
#include "secure.h"

#define POST_FRAMES 64 /* frames whose outcome is not known yet */

/* Outcomes of frames since the last call. */
struct post_outcome {
    unsigned sent;   /* at least one receiver was sent all packets of the frame */
    unsigned lost;   /* no receiver was sent all packets */
    int64_t latency; /* ns from the write to the last packet, of the last frame sent */
};

struct post {
    struct outlet *outlet; /* the thread's while it runs */
    struct secure *secure; /* NULL: not encrypted */
    pthread_t thread;
    pthread_mutex_t lock; /* of all below */
    int wake;             /* eventfd: a packet is due earlier than `until` */
    int64_t until;        /* when the thread wakes up, unless a report comes */
    bool running, stopping;
    struct stream_tx tx;
    unsigned missed;      /* receivers that lack a packet of the frame that is being sent */
    unsigned first, open; /* of `written`: frames handed over and not sent completely */
    int64_t written[POST_FRAMES];
    struct post_outcome outcome;
};

/*
 * Start the thread. Unless `secure` is NULL, each packet is encrypted once for all receivers, and reports are
 * decrypted; settings->header includes the bytes that this adds. The open outlet and `secure` stay the caller's, and
 * must be there until post_stop() returns. 0 or -errno.
 */
int post_start(struct post *post, struct outlet *outlet, struct secure *secure,
               const struct stream_tx_settings *settings);

/* Another frame interval, ns. */
void post_set_interval(struct post *post, int64_t interval);

/* Bytes that the next frame may have; 0: skip it, since former frames are not sent yet. */
size_t post_allowance(struct post *post);

/* Whether a receiver needs a picture to begin with, and the bytes of it; see stream_tx_wants_refresh(). */
bool post_wants_refresh(struct post *post, size_t *whole);

/*
 * Hand over an encoded frame, which was written at `written`; `packet`: see stream_tx_frame(). Its first packet goes
 * out before the call returns. False if there is no room: then no packet of it is sent.
 */
bool post_frame(struct post *post, int64_t written, const struct rtp_packet *packet, const uint8_t *data, size_t size);

/* Whether another packet of this stream may go out, `size` bytes with IP and UDP headers; see stream_tx_other(). */
bool post_other(struct post *post, size_t size);

/* Outcomes of frames since the last call; each frame that post_frame() accepted appears once. */
struct post_outcome post_collect(struct post *post);

/* A copy of the counters of stream_tx.h, of the reports (feedback.h) and of the outlet. */
void post_counts(struct post *post, uint64_t tx[STREAM_TX_COUNTS], uint64_t feedback[FEEDBACK_COUNTS],
                 struct outlet *outlet);

/* Loss of the worst receiver, and lost packets in sequence: feedback_losses(). */
void post_losses(struct post *post, double *loss, double *run);

/* Send waiting packets, for at most one frame interval, and stop the thread. The rest is lost, and counted. */
void post_stop(struct post *post);

#endif
