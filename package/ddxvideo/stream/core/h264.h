/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * H.264 in RTP (RFC 6184, packetization mode 1). A frame of up to RTP_WHOLE bytes is one packet: a NAL unit, or a
 * STAP-A. Of a larger frame, each NAL unit of more than RTP_WHOLE bytes is split into FU-As whose packets differ in
 * size by at most a byte; the smaller units before it, which are parameter sets, share one packet.
 */
#ifndef DDXVIDEO_H264_H
#define DDXVIDEO_H264_H

#include "chunk.h"
#include "rtp.h"

enum { H264_SPS = 7, H264_PPS = 8, H264_STAP_A = 24, H264_FU_A = 28 };

/* A NAL unit in a byte stream (Annex B), without its start code. */
struct h264_nal {
    const uint8_t *data;
    size_t size;
};

/* The next NAL unit from *at on; *at moves past it. False at the end. */
bool h264_next_nal(const uint8_t **at, const uint8_t *end, struct h264_nal *nal);

/* ---- Frame to payloads ---- */

struct h264_packer {
    const uint8_t *at, *end; /* the unread part */
    struct h264_nal nal;     /* the next unit, or its rest while it is fragmented */
    bool has_nal;
    uint8_t fragmented; /* the first byte of the NAL unit that is being fragmented, or 0 */
    unsigned parts;     /* number of packets for its rest */
    size_t less;        /* number of bytes by which the next packet's payload is smaller */
};

/* Begin with an encoded frame, which must not change until all payloads are taken. */
void h264_pack(struct h264_packer *packer, const uint8_t *frame, size_t size);

/* The next payload into to[RTP_ROOM]; its size, 0 when there is none left. *last: none follows. */
size_t h264_pack_next(struct h264_packer *packer, uint8_t *to, bool *last);

/* ---- Payloads to frame ---- */

struct h264_unpacker {
    bool in_fragments;
    size_t begin; /* where the fragmented NAL unit begins in the frame */
};

/*
 * Append a payload to the frame. `gap`: packets before it are missing; NAL units that are not whole are left out. False
 * if the payload is malformed; then none or a part of it was added, in whole NAL units.
 */
bool h264_unpack(struct h264_unpacker *unpacker, struct chunk *frame, const uint8_t *payload, size_t size, bool gap);

/* The frame has no more payloads: remove an incomplete NAL unit. */
void h264_unpack_end(struct h264_unpacker *unpacker, struct chunk *frame);

/* ---- Either codec ---- */

/* Whether a frame has what a decoder needs to begin: parameter sets (H.264), or a VOL header (MPEG-4). */
bool codec_can_begin(enum rtp_type type, const uint8_t *data, size_t size);

#endif
