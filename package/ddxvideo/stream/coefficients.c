/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "coefficients.h"

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
