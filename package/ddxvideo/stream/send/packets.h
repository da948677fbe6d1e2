/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Splits an encoded frame into RTP packets. */
#ifndef DDXVIDEO_PACKETS_H
#define DDXVIDEO_PACKETS_H

#include "stream_tx.h"
#include "encoder.h"
#include "h264.h"
#include "mpeg4.h"

struct packets {
    uint16_t sequence; /* of the next packet */
    struct mpeg4_packer mpeg4;
    unsigned count; /* packets of the last frame; more than STREAM_TX_QUEUE: the frame does not fit */
    struct stream_tx_packet packet[STREAM_TX_QUEUE];
    uint8_t data[STREAM_TX_QUEUE][RTP_PACKET_MAX];
};

/*
 * Pack a frame. `packet` describes all of its packets: payload type, time, SSRC, frame. The packets are valid until the
 * next call. False if the frame takes more than STREAM_TX_QUEUE packets.
 */
bool packets_make(struct packets *packets, const struct encoded *encoded, struct rtp_packet packet);

#endif
