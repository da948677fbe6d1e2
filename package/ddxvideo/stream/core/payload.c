/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "payload.h"

#include <stdlib.h>
#include <string.h>

#include "bits.h"
#include "rtp.h"

/* ---- A growing buffer ---- */

#define FIRST (16u << 10)

bool chunk_add(struct chunk *chunk, const void *data, size_t size) {
    if (size > CHUNK_MAX - chunk->size)
        return false;
    if (chunk->size + size > chunk->room) {
        size_t room = chunk->room ? chunk->room : FIRST;

        while (room < chunk->size + size)
            room *= 2;
        uint8_t *larger = realloc(chunk->data, room + CHUNK_PADDING);
        if (!larger)
            return false;
        chunk->data = larger;
        chunk->room = room;
    }
    if (data && size)
        memcpy(chunk->data + chunk->size, data, size);
    chunk->size += size;
    return true;
}

void chunk_pad(struct chunk *chunk) {
    memset(chunk->data + chunk->size, 0, CHUNK_PADDING);
}

void chunk_free(struct chunk *chunk) {
    free(chunk->data);
    *chunk = (struct chunk){0};
}

/* ---- H.264 ---- */

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

/* ---- MPEG-4 ---- */

enum { VOL_FIRST = 0x20, VOL_LAST = 0x2f, VOS = 0xb0, GOV = 0xb3, VOP = 0xb6 }; /* the byte after 00 00 01 */
enum { STUDIO_FIRST = 0xe1, STUDIO_LAST = 0xe8 };                               /* profile_and_level_indication */
enum { CODING_I, CODING_P };

#define MARKER_LEAST 16 /* zeros of a resync marker in an I-VOP; the most are 22 */

static unsigned bits_for(unsigned values) {
    unsigned bits = 1;

    while (bits < 16 && 1u << bits < values)
        bits++;
    return bits;
}

/* A VOL header, after its start code. ISO 14496-2, 6.2.3 */
static struct mpeg4_vol parse_vol(const uint8_t *data, size_t size) {
    struct bits bits = {data, size, 0};
    struct mpeg4_vol vol = {0};

    bits_get(&bits, 1 + 8); /* random_accessible_vol, video_object_type_indication */
    if (bits_get(&bits, 1)) /* is_object_layer_identifier */
        bits_get(&bits, 4 + 3);
    if (bits_get(&bits, 4) == 15) /* aspect_ratio_info: extended_par */
        bits_get(&bits, 8 + 8);
    if (bits_get(&bits, 1)) { /* vol_control_parameters */
        bits_get(&bits, 2 + 1);
        if (bits_get(&bits, 1)) { /* vbv_parameters: 79 bits */
            bits_get(&bits, 32);
            bits_get(&bits, 32);
            bits_get(&bits, 15);
        }
    }
    unsigned shape = bits_get(&bits, 2);
    bits_get(&bits, 1); /* marker_bit */
    vol.time_bits = bits_for(bits_get(&bits, 16));
    bits_get(&bits, 1);
    if (bits_get(&bits, 1)) /* fixed_vop_rate */
        bits_get(&bits, vol.time_bits);
    if (shape) /* not rectangular */
        return vol;
    bits_get(&bits, 1);
    vol.width = bits_get(&bits, 13);
    bits_get(&bits, 1);
    vol.height = bits_get(&bits, 13);
    return vol;
}

bool mpeg4_next_vol(const uint8_t **at, const uint8_t *end, struct mpeg4_vol *vol) {
    for (; end - *at >= 4; ++*at) {
        const uint8_t *code = *at;

        if (code[0] || code[1] || code[2] != 1 || code[3] < VOL_FIRST || code[3] > VOL_LAST)
            continue;
        *at += 4;
        *vol = parse_vol(*at, (size_t)(end - *at));
        return true;
    }
    return false;
}

bool mpeg4_is_studio(const uint8_t *frame, size_t size) {
    for (size_t at = 0; at + 5 <= size; at++)
        if (!frame[at] && !frame[at + 1] && frame[at + 2] == 1 && frame[at + 3] == VOS &&
            frame[at + 4] >= STUDIO_FIRST && frame[at + 4] <= STUDIO_LAST)
            return true;
    return false;
}

/* A VOP header, after its start code: the number of zeros in this VOP's resync markers. 6.2.5, 6.3.5.2 */
static unsigned vop_marker_bits(const uint8_t *data, size_t size, unsigned time_bits) {
    struct bits bits = {data, size, 0};
    unsigned coding = bits_get(&bits, 2);

    while (bits.at < 8 * size && bits_get(&bits, 1)) /* modulo_time_base */
        continue;
    bits_get(&bits, 1 + time_bits + 1);
    if (!bits_get(&bits, 1) || coding != CODING_P) /* vop_coded */
        return MARKER_LEAST;
    bits_get(&bits, 1 + 3 + 5);                   /* vop_rounding_type, intra_dc_vlc_thr, vop_quant */
    return MARKER_LEAST - 1 + bits_get(&bits, 3); /* vop_fcode_forward */
}

/* Whether a resync marker (or a start code) begins here, at a byte's boundary. */
static bool is_marker(const uint8_t *at, const uint8_t *end, unsigned marker_bits) {
    if (end - at < 4 || at[0] || at[1])
        return false;
    struct bits bits = {at, (size_t)(end - at), 0};
    return bits_get(&bits, marker_bits + 1) == 1;
}

static const uint8_t *find_vop(struct mpeg4_packer *packer) {
    for (const uint8_t *at = packer->at; packer->end - at >= 4; at++) {
        if (at[0] || at[1] || at[2] != 1)
            continue;
        if (at[3] >= VOL_FIRST && at[3] <= VOL_LAST)
            packer->time_bits = parse_vol(at + 4, (size_t)(packer->end - at - 4)).time_bits;
        if (at[3] == VOP)
            return at + 4;
    }
    return packer->end;
}

void mpeg4_pack(struct mpeg4_packer *packer, const uint8_t *frame, size_t size) {
    packer->at = frame;
    packer->end = frame + size;
    packer->less = RTP_FIRST_LESS;
    const uint8_t *vop = find_vop(packer);
    packer->marker_bits = vop_marker_bits(vop, (size_t)(packer->end - vop), packer->time_bits);
}

/*
 * The end of a payload of about `share` bytes, at most `room`: the first start of a video packet from `share` on,
 * otherwise the last start before it, otherwise `share` itself.
 */
static const uint8_t *choose_cut(const struct mpeg4_packer *packer, size_t share, size_t room) {
    const uint8_t *best = packer->at + share;

    for (const uint8_t *cut = best; cut <= packer->at + room; cut++)
        if (is_marker(cut, packer->end, packer->marker_bits))
            return cut;
    for (const uint8_t *cut = best; cut > packer->at; cut--)
        if (is_marker(cut, packer->end, packer->marker_bits))
            return cut;
    return best;
}

size_t mpeg4_pack_next(struct mpeg4_packer *packer, uint8_t *to, bool *last) {
    size_t size = (size_t)(packer->end - packer->at), room = RTP_ROOM - packer->less;

    if (!size)
        return 0;
    if (size > room) {
        size_t all = size + packer->less, parts = (all + RTP_ROOM - 1) / RTP_ROOM;

        size = (size_t)(choose_cut(packer, (all + parts - 1) / parts - packer->less, room) - packer->at);
    }
    packer->less = 0;
    memcpy(to, packer->at, size);
    packer->at += size;
    *last = packer->at == packer->end;
    return size;
}

size_t mpeg4_headers(const uint8_t *frame, size_t size) {
    for (size_t at = 0; at + 4 <= size; at++)
        if (!frame[at] && !frame[at + 1] && frame[at + 2] == 1 && (frame[at + 3] == VOP || frame[at + 3] == GOV))
            return at;
    return 0;
}

bool mpeg4_is_start(const uint8_t *payload, size_t size) {
    return size > 2 && !payload[0] && !payload[1] && payload[2];
}

bool mpeg4_unpack(struct mpeg4_unpacker *unpacker, struct chunk *frame, const uint8_t *payload, size_t size, bool gap) {
    if (!size)
        return false;
    if (gap || !frame->size)
        unpacker->skipping = true;
    if (mpeg4_is_start(payload, size))
        unpacker->skipping = false;
    return unpacker->skipping || chunk_add(frame, payload, size);
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
