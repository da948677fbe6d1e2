/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Decides which packet is sent when: packets of encoded frames, paced; repair packets in answer to reports, or in
 * advance without reports; all of them within the budget. No sockets, no clock, no threads: the caller passes the time
 * (CLOCK_MONOTONIC, ns) and serialises the calls. Fixed memory. No call blocks; each one's work is bounded.
 *
 * Budget. Repair has priority: a picture with a gap is worth nothing, and neither are those after it. The next frame
 * gets what repair leaves (stream_tx_allowance()), but at least a part of the rate that a fair picture needs: with
 * several receivers, of which one always misses something, repair would take everything. Packets that the bucket cannot
 * pay for wait, and frames are left out.
 *
 * Pacing. The first three packets of a frame are sent at once, so a frame of usual size does not wait. The others are
 * at most 1 ms apart, and are sent within half a frame interval.
 *
 * Without reports for a second, or from the start, repair packets follow each frame in advance. Their number depends on
 * the last reported loss, or is settings.ratio. Each third one covers the whole window and the others 8 frames
 * only: a repair packet is as long as the longest packet that it covers, and a shorter window has a shorter one. When
 * reports have just stopped, the rate is reduced as well: the link may be congested.
 */
#ifndef DDXVIDEO_STREAM_TX_H
#define DDXVIDEO_STREAM_TX_H

#include "feedback.h"
#include "rate.h"
#include "payload.h"
#include "repair.h"

#define STREAM_TX_QUEUE REPAIR_WAITING /* media packets that wait */
#define STREAM_TX_VIDEO \
    0.7                     /* of the rate that frames get, at most: what a loss of 30 % leaves. So a loss changes
                             * pictures little, and repair has a reserve before reports say how much it takes */
#define STREAM_TX_RATIO 2.3 /* of repair packets to media packets, for 30 % loss in bursts */

enum stream_tx_port { STREAM_TX_MEDIA, STREAM_TX_REPAIR };

enum stream_tx_count {
    STREAM_TX_PACKETS, /* handed over = sent + dropped + waiting */
    STREAM_TX_SENT,
    STREAM_TX_DROPPED,     /* no room in the queue, or not an RTP packet */
    STREAM_TX_REPAIRS,     /* repair packets sent */
    STREAM_TX_MEDIA_BYTES, /* of media packets, IP and UDP headers included */
    STREAM_TX_BYTES,       /* of everything sent, IP and UDP headers included */
    STREAM_TX_OTHERS, /* stream_tx_other(): packets that may be sent, and packets that the budget could not pay for */
    STREAM_TX_OTHERS_LOST,
    STREAM_TX_COUNTS
};

struct stream_tx_settings {
    int64_t wire;     /* bit/s of everything sent to a receiver, 50,000 at least: the bucket must hold a packet */
    int64_t video;    /* bit/s of encoded frames, at most; 0: STREAM_TX_VIDEO of the rate */
    int64_t interval; /* ns from frame to frame */
    size_t header;    /* bytes added to an RTP packet: IP and UDP headers, encryption */
    bool repair;      /* repair packets are sent */
    int64_t renewal;  /* ns from one regular renewal to the next; 0: the encoder makes them by itself */
    double ratio;     /* of repair packets to media packets while no receiver has reported: STREAM_TX_RATIO */
    double others;    /* bytes of other packets for each byte of media, at least */
    uint32_t media_ssrc, repair_ssrc;
    uint16_t media_sequence, repair_sequence; /* of the first packets, at random */
};

struct stream_tx_packet {
    const uint8_t *data; /* a whole RTP packet */
    size_t size;         /* RTP_PACKET_MAX at most */
};

struct stream_tx {
    struct stream_tx_settings settings; /* `video` and `interval` may be changed at any time */
    uint64_t count[STREAM_TX_COUNTS];
    struct budget budget;
    struct link_rate link; /* at most a little less than settings.wire */
    struct feedback feedback;
    uint16_t sequence; /* of the next media packet */
    struct mpeg4_packer mpeg4;
    int64_t next, gap;                             /* earliest time of the next packet; ns between packets */
    unsigned burst;                                /* packets to send without a gap */
    int64_t sent;                                  /* time of the last packet */
    bool begun;                                    /* a media packet was sent */
    uint32_t esi;                                  /* its extended sequence number */
    unsigned waiting;                              /* media packets, in the window */
    double owed;                                   /* repair packets to be sent in advance */
    unsigned advance;                              /* that were sent in advance */
    double media_share, repair_share, other_share; /* bytes sent; older ones count less */
    unsigned skipped; /* frames that were left out in sequence, for repair or in an outage, */
    double patience;  /* and those that still may be */
    struct frame_rate frames;
    bool refresh;
    int64_t refreshed, whole; /* times of the last answer to a request, and of the last whole picture */
    int64_t renewed;          /* time of the last renewal, regular or not */
    struct repair_window window;
};

void stream_tx_init(struct stream_tx *tx, const struct stream_tx_settings *settings, int64_t now);

/* Bytes that the next frame may have; 0: there is no room for a frame. Drop it without encoding it. */
size_t stream_tx_allowance(struct stream_tx *tx, int64_t now);

/*
 * Split an encoded frame into packets, which wait to be sent. `packet` has its type, time and frame, whose number rises
 * by one; SSRC and sequence numbers are the stream's. False if there is no room for all packets: then none is sent, and
 * the receivers notice that a frame is missing.
 */
bool stream_tx_frame(struct stream_tx *tx, int64_t now, struct rtp_packet packet, const uint8_t *data, size_t size);

/* The same for a frame, number `frame`, that is in packets already: their sequence numbers follow each other. Packets
 * that find no room are dropped. */
void stream_tx_packets(struct stream_tx *tx, int64_t now, uint16_t frame, const struct stream_tx_packet *packets,
                       unsigned count);

/* Use a datagram from the port for reports. `address`: a hash of its sender's address. */
void stream_tx_report(struct stream_tx *tx, int64_t now, const uint8_t *data, size_t size, uint64_t address);

/* Take the next packet that is due: to[REPAIR_MAX], its size and its port. False if none is due. Call it at
 * stream_tx_deadline(), and after each of the other calls, until it returns false. The packet counts as sent. */
bool stream_tx_next(struct stream_tx *tx, int64_t now, uint8_t *to, size_t *size, enum stream_tx_port *port);

/* The time at which the next packet is due if nothing else happens; INT64_MAX: none. */
int64_t stream_tx_deadline(struct stream_tx *tx, int64_t now);

/* Whether another packet (an announcement, a packet of another copy of the stream) may be sent now: `size` bytes on the
 * wire. If so, they are taken from the budget; if not, the packet counts as lost. */
bool stream_tx_other(struct stream_tx *tx, int64_t now, size_t size);

/*
 * Whether a receiver needs a whole picture. True at most once a second; that ends the request. *whole: bytes of a whole
 * picture that may be sent at once; 0: the next frames must renew the picture, because one was sent less than four
 * seconds ago. So requests, which can be forged, do not fill the rate with bad pictures.
 *
 * A renewal is also wanted each settings.renewal, for receivers that cannot ask, and only each 20 s while a receiver
 * that reports loses packets: what the loss leaves of the rate is too little for good pictures during one, and a
 * receiver without reports and repair loses most frames then.
 */
bool stream_tx_wants_refresh(struct stream_tx *tx, int64_t now, size_t *whole);

#endif
