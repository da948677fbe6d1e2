/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The field GF(256) with the polynomial x^8 + x^4 + x^3 + x^2 + 1 (RFC 8681, section 3.7.1). Its sum is XOR.
 * And the coefficients of repair packets, which sender and receiver compute from a Repair_Key. */
#ifndef DDXVIDEO_GF256_H
#define DDXVIDEO_GF256_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

uint8_t gf256_multiply(uint8_t a, uint8_t b);

/* 1 / a, of an a that is not 0. */
uint8_t gf256_inverse(uint8_t a);

/* to[i] += factor * from[i], for `size` bytes. The two do not overlap, or are the same. */
void gf256_add(uint8_t *to, const uint8_t *from, uint8_t factor, size_t size);

/* at[i] = factor * at[i] */
static inline void gf256_scale(uint8_t *at, uint8_t factor, size_t size) {
    gf256_add(at, at, factor ^ 1, size);
}

/* Whether all of the bytes are 0. */
bool gf256_is_zero(const uint8_t *data, size_t size);

/* The pseudorandom number generator TinyMT32 with the parameters of RFC 8682. */
struct tinymt32 {
    uint32_t state[4];
};

void tinymt32_init(struct tinymt32 *random, uint32_t seed);
uint32_t tinymt32_next(struct tinymt32 *random);

/* The first `count` coefficients of a key, none of them 0: RFC 8681, section 3.6, with m = 8 and DT = 15. */
void repair_coefficients(uint16_t key, uint8_t *to, unsigned count);

#endif
