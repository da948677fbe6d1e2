/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Encoded frames in the payloads of RTP packets, and back: H.264 and MPEG-4. */
#ifndef DDXVIDEO_PAYLOAD_H
#define DDXVIDEO_PAYLOAD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "rtp.h"

/* ---- A growing buffer: an encoded frame while it is put together from packets ---- */

#define CHUNK_MAX (8u << 20) /* no frame of a stream for a wireless link is larger */
#define CHUNK_PADDING 64     /* zero bytes after the last one, which libavcodec may read */

struct chunk {
    uint8_t *data;
    size_t size;
    size_t room; /* allocated, without the padding */
};

/* Append; `data` NULL appends `size` bytes that the caller fills. False if it would grow too large, or no memory. */
bool chunk_add(struct chunk *chunk, const void *data, size_t size);

/* Write zeros after the end. The chunk must have had at least one byte. */
void chunk_pad(struct chunk *chunk);

void chunk_free(struct chunk *chunk);

/*
 * ---- H.264 ----
 *
 * In RTP (RFC 6184, packetization mode 1). A frame of up to RTP_WHOLE bytes is one packet: a NAL unit, or a
 * STAP-A. Of a larger frame, each NAL unit of more than RTP_WHOLE bytes is split into FU-As whose packets differ in
 * size by at most a byte; the smaller units before it, which are parameter sets, share one packet.
 */

enum { H264_SPS = 7, H264_PPS = 8, H264_STAP_A = 24, H264_FU_A = 28 };

/* A NAL unit in a byte stream (Annex B), without its start code. */
struct h264_nal {
    const uint8_t *data;
    size_t size;
};

/* The next NAL unit from *at on; *at moves past it. False at the end. */
bool h264_next_nal(const uint8_t **at, const uint8_t *end, struct h264_nal *nal);

/* Frame to payloads. */
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

/* Payloads to frame. */
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

/*
 * ---- MPEG-4 part 2 ----
 *
 * In RTP (RFC 6416). Every packet begins at a header or at a video packet (its resync marker), so each
 * one that arrives can be decoded even if others are lost; only a video packet too large for one packet is fragmented.
 * Within this limit, the packets of a frame are about equal in size.
 */

struct mpeg4_packer {
    const uint8_t *at, *end;
    unsigned time_bits;   /* of vop_time_increment, from the last VOL header */
    unsigned marker_bits; /* zeros of this frame's resync marker */
    size_t less;          /* number of bytes by which the next packet's payload is smaller */
};

/* Begin with an encoded frame. The packer must have seen the stream's frames from the first one on, or start as 0. */
void mpeg4_pack(struct mpeg4_packer *packer, const uint8_t *frame, size_t size);

/* Like h264_pack_next(). */
size_t mpeg4_pack_next(struct mpeg4_packer *packer, uint8_t *to, bool *last);

/* Properties of a stream's pictures, known before one is decoded. */
struct mpeg4_vol {
    unsigned width, height; /* 0: no rectangle */
    unsigned time_bits;     /* of vop_time_increment */
};

/* The next VOL header from *at on; *at moves past its start code. False at the end. */
bool mpeg4_next_vol(const uint8_t **at, const uint8_t *end, struct mpeg4_vol *vol);

/* Whether the frame begins a stream of a studio profile: 4:2:2 or more, with more than 8 bits. */
bool mpeg4_is_studio(const uint8_t *frame, size_t size);

/* Bytes of the headers before the first picture of a frame; 0 if it has none, or no picture. */
size_t mpeg4_headers(const uint8_t *frame, size_t size);

/* Whether a payload begins at a header or at a resync marker. */
bool mpeg4_is_start(const uint8_t *payload, size_t size);

struct mpeg4_unpacker {
    bool skipping; /* up to the next start */
};

/* Like h264_unpack(). After a gap, and in a new frame, everything up to the next start is skipped. */
bool mpeg4_unpack(struct mpeg4_unpacker *unpacker, struct chunk *frame, const uint8_t *payload, size_t size, bool gap);

/* ---- Either codec ---- */

/* Whether a frame has what a decoder needs to begin: parameter sets (H.264), or a VOL header (MPEG-4). */
bool codec_can_begin(enum rtp_type type, const uint8_t *data, size_t size);

#endif
