/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "gf256.h"

#include <string.h>

/* ---- The coefficients of a repair packet ---- */

/* RFC 8682, section 2.1: the only set of parameters that it allows. */
#define MAT1 UINT32_C(0x8f7011ee)
#define MAT2 UINT32_C(0xfc78ff1f)
#define TMAT UINT32_C(0x3793fdff)

static void step(uint32_t *state) {
    uint32_t x = (state[0] & 0x7fffffff) ^ state[1] ^ state[2], y = state[3];

    x ^= x << 1;
    y ^= y >> 1 ^ x;
    state[0] = state[1];
    state[1] = state[2] ^ (y & 1 ? MAT1 : 0);
    state[2] = x ^ y << 10 ^ (y & 1 ? MAT2 : 0);
    state[3] = y;
}

void tinymt32_init(struct tinymt32 *random, uint32_t seed) {
    uint32_t *state = random->state;

    *random = (struct tinymt32){{seed, MAT1, MAT2, TMAT}};
    for (uint32_t i = 1; i < 8; i++) {
        uint32_t last = state[(i - 1) & 3];

        state[i & 3] ^= i + UINT32_C(1812433253) * (last ^ last >> 30);
    }
    for (int i = 0; i < 8; i++)
        step(state);
}

uint32_t tinymt32_next(struct tinymt32 *random) {
    const uint32_t *state = random->state;

    step(random->state);
    uint32_t sum = state[0] + (state[2] >> 8);
    return state[3] ^ sum ^ (sum & 1 ? TMAT : 0);
}

void repair_coefficients(uint16_t key, uint8_t *to, unsigned count) {
    struct tinymt32 random;

    tinymt32_init(&random, key);
    for (unsigned i = 0; i < count; i++)
        do
            to[i] = (uint8_t)tinymt32_next(&random);
        while (!to[i]);
}

/* ---- The field ---- */

#define POLYNOMIAL 0x11d
#define EACH_BYTE UINT64_C(0x0101010101010101)

static uint8_t twice(uint8_t a) {
    return (uint8_t)(a << 1 ^ (a >> 7) * POLYNOMIAL);
}

uint8_t gf256_multiply(uint8_t a, uint8_t b) {
    uint8_t product = 0;

    for (; b; b >>= 1, a = twice(a))
        if (b & 1)
            product ^= a;
    return product;
}

/* a^254, since a^255 is 1. */
uint8_t gf256_inverse(uint8_t a) {
    uint8_t inverse = 1;

    for (int bit = 1; bit < 8; bit++) {
        a = gf256_multiply(a, a);
        inverse = gf256_multiply(inverse, a);
    }
    return inverse;
}

/* Sums of the 4 values, in the order of the bits. */
static void fill_16(uint8_t *to, const uint8_t *value) {
    to[0] = 0;
    for (unsigned i = 1; i < 16; i++)
        to[i] = to[i & (i - 1)] ^ value[__builtin_ctz(i)];
}

/*
 * All multiples of a factor. They are computed in each call, which costs a fifth of the multiplication of a packet: a
 * table for all factors is larger than the first cache of small processors, and some call would have to fill it first.
 */
static void fill_table(uint8_t table[256], uint8_t factor) {
    uint8_t power[8], low[16], high[16];
    uint64_t both[2];

    for (int i = 0; i < 8; i++, factor = twice(factor))
        power[i] = factor;
    fill_16(low, power);
    fill_16(high, power + 4);
    memcpy(both, low, 16);
    for (unsigned i = 0; i < 16; i++) {
        uint64_t sums[] = {both[0] ^ high[i] * EACH_BYTE, both[1] ^ high[i] * EACH_BYTE};

        memcpy(table + 16 * i, sums, 16);
    }
}

/* The products of 4 bytes. */
static uint32_t multiply_4(const uint8_t table[256], uint32_t in) {
    return table[in & 255] | (uint32_t)table[in >> 8 & 255] << 8 | (uint32_t)table[in >> 16 & 255] << 16 |
           (uint32_t)table[in >> 24] << 24;
}

void gf256_add(uint8_t *to, const uint8_t *from, uint8_t factor, size_t size) {
    uint8_t table[256];

    if (!factor)
        return;
    fill_table(table, factor);
    for (; size >= 8; size -= 8, to += 8, from += 8) {
        uint32_t in[2], out[2];

        memcpy(in, from, 8);
        memcpy(out, to, 8);
        out[0] ^= multiply_4(table, in[0]);
        out[1] ^= multiply_4(table, in[1]);
        memcpy(to, out, 8);
    }
    for (; size; size--)
        *to++ ^= table[*from++];
}

bool gf256_is_zero(const uint8_t *data, size_t size) {
    while (size && !*data) {
        data++;
        size--;
    }
    return !size;
}
