/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <emmintrin.h>
#include <stdint.h>

#define VARIANT sse2
#define LANES 16
typedef __m128i vector;

#define splat(byte) _mm_set1_epi8((char)(byte))
#define add _mm_add_epi8
#define sub _mm_sub_epi8
#define add_sat _mm_adds_epu8
#define sub_sat _mm_subs_epu8
#define least_of _mm_min_epu8
#define both _mm_and_si128
#define either _mm_or_si128
#define differ _mm_xor_si128
#define equal _mm_cmpeq_epi8
#define shift_right _mm_srli_epi16
#define done() ((void)0)

static inline vector load(const uint8_t *at) {
    return _mm_loadu_si128((const __m128i *)at);
}

static inline void store(uint8_t *at, vector v) {
    _mm_storeu_si128((__m128i *)at, v);
}

static inline vector enter(vector v, vector low) {
    return _mm_or_si128(_mm_slli_si128(v, 1), _mm_srli_si128(low, 15));
}

static inline vector leave(vector v, vector high) {
    return _mm_or_si128(_mm_srli_si128(v, 1), _mm_slli_si128(high, 15));
}

static inline uint8_t lowest(vector v) {
    return (uint8_t)_mm_cvtsi128_si32(v);
}

static inline vector least_splat(vector v) {
    v = least_of(v, _mm_srli_si128(v, 8));
    v = least_of(v, _mm_srli_si128(v, 4));
    v = least_of(v, _mm_srli_si128(v, 2));
    v = least_of(v, _mm_srli_si128(v, 1));
    v = _mm_unpacklo_epi8(v, v);
    return _mm_shuffle_epi32(_mm_shufflelo_epi16(v, 0), 0);
}

static inline int last_equal(const uint8_t *bytes, int count, uint8_t byte) {
    vector wanted = splat(byte);

    for (int i = count - LANES; i >= 0; i -= LANES) {
        unsigned mask = (unsigned)_mm_movemask_epi8(equal(load(bytes + i), wanted));
        if (mask)
            return i + 31 - __builtin_clz(mask);
    }
    return 0;
}

static inline int count_at_most(const uint8_t *bytes, int count, uint8_t most) {
    vector limit = splat(most), zero = splat(0), sum = zero;

    for (int i = 0; i < count; i += LANES)
        sum = sub(sum, equal(sub_sat(load(bytes + i), limit), zero));
    sum = _mm_sad_epu8(sum, zero);
    return _mm_cvtsi128_si32(_mm_add_epi32(sum, _mm_srli_si128(sum, 8)));
}

#include "kernel_rows.h"
