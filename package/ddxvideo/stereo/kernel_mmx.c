/* SPDX-License-Identifier: GPL-2.0-or-later */
/* MMX of the first processors, without the later additions of SSE: no pminub, no pmovmskb. */
#include <mmintrin.h>
#include <stdint.h>
#include <string.h>

#define VARIANT mmx
#define LANES 8
typedef __m64 vector;

#define splat(byte) _mm_set1_pi8((char)(byte))
#define add _mm_add_pi8
#define sub _mm_sub_pi8
#define add_sat _mm_adds_pu8
#define sub_sat _mm_subs_pu8
#define both _mm_and_si64
#define either _mm_or_si64
#define differ _mm_xor_si64
#define equal _mm_cmpeq_pi8
#define shift_right _mm_srli_pi16
#define done() _mm_empty()

static inline vector load(const uint8_t *at) {
    vector v;

    memcpy(&v, at, sizeof v);
    return v;
}

static inline void store(uint8_t *at, vector v) {
    memcpy(at, &v, sizeof v);
}

static inline vector least_of(vector a, vector b) {
    return sub(a, sub_sat(a, b));
}

static inline vector enter(vector v, vector low) {
    return _mm_or_si64(_mm_slli_si64(v, 8), _mm_srli_si64(low, 56));
}

static inline vector leave(vector v, vector high) {
    return _mm_or_si64(_mm_srli_si64(v, 8), _mm_slli_si64(high, 56));
}

static inline uint8_t lowest(vector v) {
    return (uint8_t)_mm_cvtsi64_si32(v);
}

static inline vector least_splat(vector v) {
    v = least_of(v, _mm_srli_si64(v, 32));
    v = least_of(v, _mm_srli_si64(v, 16));
    v = least_of(v, _mm_srli_si64(v, 8));
    v = _mm_unpacklo_pi8(v, v);
    v = _mm_unpacklo_pi16(v, v);
    return _mm_unpacklo_pi32(v, v);
}

static inline int last_equal(const uint8_t *bytes, int count, uint8_t byte) {
    vector wanted = splat(byte);

    for (int i = count - LANES; i >= 0; i -= LANES) {
        vector found = equal(load(bytes + i), wanted);
        unsigned low = (unsigned)_mm_cvtsi64_si32(found);
        unsigned high = (unsigned)_mm_cvtsi64_si32(_mm_srli_si64(found, 32));
        if (high)
            return i + 4 + (31 - __builtin_clz(high)) / 8;
        if (low)
            return i + (31 - __builtin_clz(low)) / 8;
    }
    return 0;
}

static inline int count_at_most(const uint8_t *bytes, int count, uint8_t most) {
    vector limit = splat(most), zero = splat(0), sum = zero;

    for (int i = 0; i < count; i += LANES)
        sum = sub(sum, equal(sub_sat(load(bytes + i), limit), zero));
    sum = _mm_add_pi16(_mm_unpacklo_pi8(sum, zero), _mm_unpackhi_pi8(sum, zero));
    sum = _mm_add_pi16(sum, _mm_srli_si64(sum, 32));
    sum = _mm_add_pi16(sum, _mm_srli_si64(sum, 16));
    return _mm_cvtsi64_si32(sum) & 0xffff;
}

#include "kernel_rows.h"
