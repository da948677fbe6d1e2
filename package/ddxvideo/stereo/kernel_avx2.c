/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <immintrin.h>
#include <stdint.h>

#define VARIANT avx2
#define LANES 32
typedef __m256i vector;

#define splat(byte) _mm256_set1_epi8((char)(byte))
#define add _mm256_add_epi8
#define sub _mm256_sub_epi8
#define add_sat _mm256_adds_epu8
#define sub_sat _mm256_subs_epu8
#define least_of _mm256_min_epu8
#define both _mm256_and_si256
#define either _mm256_or_si256
#define differ _mm256_xor_si256
#define equal _mm256_cmpeq_epi8
#define shift_right _mm256_srli_epi16
#define done() _mm256_zeroupper()

static inline vector load(const uint8_t *at) {
    return _mm256_loadu_si256((const __m256i *)at);
}

static inline void store(uint8_t *at, vector v) {
    _mm256_storeu_si256((__m256i *)at, v);
}

static inline vector enter(vector v, vector low) {
    return _mm256_alignr_epi8(v, _mm256_permute2x128_si256(low, v, 0x21), 15);
}

static inline vector leave(vector v, vector high) {
    return _mm256_alignr_epi8(_mm256_permute2x128_si256(v, high, 0x21), v, 1);
}

static inline uint8_t lowest(vector v) {
    return (uint8_t)_mm_cvtsi128_si32(_mm256_castsi256_si128(v));
}

static inline vector least_splat(vector v) {
    __m128i m = _mm_min_epu8(_mm256_castsi256_si128(v), _mm256_extracti128_si256(v, 1));

    return _mm256_broadcastb_epi8(_mm_minpos_epu16(_mm_min_epu8(m, _mm_srli_epi16(m, 8))));
}

/* Looks up each half of a byte, and then the carries of a full adder. */
static inline vector bits_of_halves(vector v) {
    const vector table = _mm256_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4, 0, 1, 1, 2, 1, 2, 2, 3, 1, 2,
                                          2, 3, 2, 3, 3, 4);
    const vector low = splat(0x0f);

    return add(_mm256_shuffle_epi8(table, both(v, low)), _mm256_shuffle_epi8(table, both(shift_right(v, 4), low)));
}

static inline vector bits_set(vector a, vector b, vector c) {
    vector one = differ(a, b), carry = either(both(a, b), both(one, c));
    vector two = bits_of_halves(carry);

    return add(bits_of_halves(differ(one, c)), add(two, two));
}
#define bits_set bits_set

static inline int last_equal(const uint8_t *bytes, int count, uint8_t byte) {
    vector wanted = splat(byte);

    for (int i = count - LANES; i >= 0; i -= LANES) {
        unsigned mask = (unsigned)_mm256_movemask_epi8(equal(load(bytes + i), wanted));
        if (mask)
            return i + 31 - __builtin_clz(mask);
    }
    return 0;
}

static inline int count_at_most(const uint8_t *bytes, int count, uint8_t most) {
    vector limit = splat(most), zero = splat(0);
    int sum = 0;

    for (int i = 0; i < count; i += LANES)
        sum += __builtin_popcount((unsigned)_mm256_movemask_epi8(equal(sub_sat(load(bytes + i), limit), zero)));
    return sum;
}

#include "kernel_rows.h"
