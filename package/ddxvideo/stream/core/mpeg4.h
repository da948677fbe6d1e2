/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * MPEG-4 part 2 in RTP (RFC 6416). Every packet begins at a header or at a video packet (its resync marker), so each
 * one that arrives can be decoded even if others are lost; only a video packet too large for one packet is fragmented.
 * Within this limit, the packets of a frame are about equal in size.
 */
#ifndef DDXVIDEO_MPEG4_H
#define DDXVIDEO_MPEG4_H

#include "chunk.h"

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

#endif
