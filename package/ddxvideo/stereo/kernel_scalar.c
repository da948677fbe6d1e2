/* SPDX-License-Identifier: GPL-2.0-or-later */
/* For processors without vector instructions; the other variants must give the same bits. */
#include <stdint.h>

#define VARIANT scalar
#define LANES 1
typedef uint8_t vector;

#define splat(byte) ((uint8_t)(byte))
#define add(a, b) ((uint8_t)((a) + (b)))
#define sub(a, b) ((uint8_t)((a) - (b)))
#define both(a, b) ((uint8_t)((a) & (b)))
#define either(a, b) ((uint8_t)((a) | (b)))
#define differ(a, b) ((uint8_t)((a) ^ (b)))
#define equal(a, b) ((uint8_t)((a) == (b) ? 255 : 0))
#define shift_right(v, bits) ((uint8_t)((v) >> (bits)))
#define enter(v, low) (low)
#define leave(v, high) (high)
#define lowest(v) (v)
#define least_splat(v) (v)
#define done() ((void)0)

static inline vector load(const uint8_t *at) {
    return *at;
}

static inline void store(uint8_t *at, vector v) {
    *at = v;
}

static inline vector least_of(vector a, vector b) {
    return a < b ? a : b;
}

static inline vector add_sat(vector a, vector b) {
    return a + b > 255 ? 255 : (uint8_t)(a + b);
}

static inline vector sub_sat(vector a, vector b) {
    return a > b ? (uint8_t)(a - b) : 0;
}

static inline int last_equal(const uint8_t *bytes, int count, uint8_t byte) {
    int i = count - 1;

    while (i > 0 && bytes[i] != byte)
        i--;
    return i;
}

static inline int count_at_most(const uint8_t *bytes, int count, uint8_t most) {
    int sum = 0;

    for (int i = 0; i < count; i++)
        sum += bytes[i] <= most;
    return sum;
}

#include "kernel_rows.h"
