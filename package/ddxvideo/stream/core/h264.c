/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "h264.h"

#include <string.h>

#include "bits.h"
#include "rtp.h"

#define TYPE 0x1f       /* of a NAL unit's first byte: type, */
#define IMPORTANCE 0x60 /* nal_ref_idc, */
#define FORBIDDEN 0x80  /* forbidden_zero_bit */
#define FU_START 0x80
#define FU_END 0x40
#define FU_HEADER 2
#define FU_ROOM (RTP_ROOM - FU_HEADER)

static const uint8_t start_code[4] = {0, 0, 0, 1};

/* Where the next 00 00 01 is, or the end. */
static const uint8_t *find_start(const uint8_t *at, const uint8_t *end) {
    for (; end - at >= 3; at++)
        if (!at[0] && !at[1] && at[2] == 1)
            return at;
    return end;
}

bool h264_next_nal(const uint8_t **at, const uint8_t *end, struct h264_nal *nal) {
    for (;;) {
        const uint8_t *start = find_start(*at, end);

        if (start == end) {
            *at = end;
            return false;
        }
        const uint8_t *next = find_start(start + 3, end), *stop = next;
        while (stop > start + 3 && !stop[-1]) /* zeros before a start code belong to no unit */
            stop--;
        *nal = (struct h264_nal){start + 3, (size_t)(stop - start - 3)};
        *at = next;
        if (nal->size)
            return true;
    }
}

void h264_pack(struct h264_packer *packer, const uint8_t *frame, size_t size) {
    *packer = (struct h264_packer){.at = frame, .end = frame + size, .less = RTP_FIRST_LESS};
    packer->has_nal = h264_next_nal(&packer->at, packer->end, &packer->nal);
}

static void advance(struct h264_packer *packer) {
    packer->has_nal = h264_next_nal(&packer->at, packer->end, &packer->nal);
}

static size_t pack_fragment(struct h264_packer *packer, uint8_t *to) {
    uint8_t position = 0;

    if (!packer->fragmented) {
        packer->fragmented = packer->nal.data[0];
        packer->nal.data++; /* its first byte is sent in the FU's two */
        packer->nal.size--;
        packer->parts = (unsigned)((packer->nal.size + packer->less + FU_ROOM - 1) / FU_ROOM);
        packer->parts = packer->parts < 2 ? 2 : packer->parts; /* a single one is no fragment */
        position = FU_START;
    }
    size_t all = packer->nal.size + packer->less; /* with the larger header's bytes as payload */
    size_t size = (all + packer->parts - 1) / packer->parts - packer->less;
    if (!--packer->parts)
        position |= FU_END;
    to[0] = (packer->fragmented & (uint8_t)~TYPE) | H264_FU_A;
    to[1] = position | (packer->fragmented & TYPE);
    memcpy(to + FU_HEADER, packer->nal.data, size);
    packer->nal.data += size;
    packer->nal.size -= size;
    if (position & FU_END) {
        packer->fragmented = 0;
        advance(packer);
    }
    return FU_HEADER + size;
}

/* Puts whole NAL units into one packet, as long as they fit; the first one always does. */
static size_t pack_whole(struct h264_packer *packer, uint8_t *to) {
    struct h264_nal first = packer->nal;
    size_t used = 1 + 2 + first.size; /* as STAP-A */
    unsigned count = 0;

    to[0] = H264_STAP_A;
    for (advance(packer); packer->has_nal && used + 2 + packer->nal.size <= RTP_WHOLE; advance(packer), count++) {
        put16(to + used, (uint16_t)packer->nal.size);
        memcpy(to + used + 2, packer->nal.data, packer->nal.size);
        to[0] |= packer->nal.data[0] & FORBIDDEN;
        if ((packer->nal.data[0] & IMPORTANCE) > (to[0] & IMPORTANCE))
            to[0] = (to[0] & (uint8_t)~IMPORTANCE) | (packer->nal.data[0] & IMPORTANCE);
        used += 2 + packer->nal.size;
    }
    if (!count) {
        memcpy(to, first.data, first.size);
        return first.size;
    }
    put16(to + 1, (uint16_t)first.size);
    memcpy(to + 3, first.data, first.size);
    to[0] |= first.data[0] & FORBIDDEN;
    if ((first.data[0] & IMPORTANCE) > (to[0] & IMPORTANCE))
        to[0] = (to[0] & (uint8_t)~IMPORTANCE) | (first.data[0] & IMPORTANCE);
    return used;
}

size_t h264_pack_next(struct h264_packer *packer, uint8_t *to, bool *last) {
    if (!packer->has_nal)
        return 0;
    bool large = packer->fragmented || packer->nal.size > RTP_WHOLE;
    size_t size = large ? pack_fragment(packer, to) : pack_whole(packer, to);
    packer->less = 0;
    *last = !packer->has_nal;
    return size;
}

/* ---- Payloads to frame ---- */

static bool append(struct chunk *frame, const uint8_t *nal, size_t size) {
    size_t before = frame->size;

    if (chunk_add(frame, start_code, sizeof start_code) && chunk_add(frame, nal, size))
        return true;
    frame->size = before;
    return false;
}

/* Removes the NAL unit if fragments are missing. */
static void give_up(struct h264_unpacker *unpacker, struct chunk *frame) {
    if (unpacker->in_fragments)
        frame->size = unpacker->begin;
    unpacker->in_fragments = false;
}

static bool unpack_aggregate(struct chunk *frame, const uint8_t *at, const uint8_t *end) {
    while (at < end) {
        size_t size = end - at >= 2 ? get16(at) : 0;

        if (!size || size > (size_t)(end - at - 2))
            return false;
        if (!append(frame, at + 2, size))
            return false;
        at += 2 + size;
    }
    return true;
}

static bool unpack_fragment(struct h264_unpacker *unpacker, struct chunk *frame, const uint8_t *payload, size_t size) {
    if (size <= FU_HEADER)
        return false;
    if (payload[1] & FU_START) {
        give_up(unpacker, frame);
        size_t begin = frame->size;
        uint8_t first = (payload[0] & (uint8_t)~TYPE) | (payload[1] & TYPE);
        if (!append(frame, &first, 1))
            return false;
        unpacker->begin = begin;
        unpacker->in_fragments = true;
    }
    if (!unpacker->in_fragments) /* its beginning is lost */
        return true;
    if (!chunk_add(frame, payload + FU_HEADER, size - FU_HEADER)) {
        give_up(unpacker, frame);
        return false;
    }
    if (payload[1] & FU_END)
        unpacker->in_fragments = false;
    return true;
}

bool h264_unpack(struct h264_unpacker *unpacker, struct chunk *frame, const uint8_t *payload, size_t size, bool gap) {
    if (!size)
        return false;
    uint8_t type = payload[0] & TYPE;
    if (gap || type != H264_FU_A)
        give_up(unpacker, frame);
    if (type == H264_FU_A)
        return unpack_fragment(unpacker, frame, payload, size);
    if (type == H264_STAP_A)
        return size > 1 && unpack_aggregate(frame, payload + 1, payload + size);
    if (!type || type > H264_STAP_A) /* other aggregates and fragments belong to interleaved mode */
        return false;
    return append(frame, payload, size);
}

void h264_unpack_end(struct h264_unpacker *unpacker, struct chunk *frame) {
    give_up(unpacker, frame);
}

/* ---- Either codec ---- */

#define VOL 0x20 /* the upper half of an MPEG-4 start code's last byte */

bool codec_can_begin(enum rtp_type type, const uint8_t *data, size_t size) {
    struct h264_nal nal;

    for (const uint8_t *at = data; h264_next_nal(&at, data + size, &nal);) /* MPEG-4's start codes look the same */
        if (type == RTP_H264 ? (nal.data[0] & 31) == H264_SPS : (nal.data[0] & 0xf0) == VOL)
            return true;
    return false;
}
