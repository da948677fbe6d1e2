/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "mpeg4.h"

#include <string.h>

#include "bits.h"
#include "rtp.h"

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
