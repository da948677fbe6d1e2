/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The coefficients of a repair packet: sender and receiver compute them from its Repair_Key. */
#ifndef DDXVIDEO_COEFFICIENTS_H
#define DDXVIDEO_COEFFICIENTS_H

#include <stdint.h>

/* The pseudorandom number generator TinyMT32 with the parameters of RFC 8682. */
struct tinymt32 {
    uint32_t state[4];
};

void tinymt32_init(struct tinymt32 *random, uint32_t seed);
uint32_t tinymt32_next(struct tinymt32 *random);

/* The first `count` coefficients of a key, none of them 0: RFC 8681, section 3.6, with m = 8 and DT = 15. */
void repair_coefficients(uint16_t key, uint8_t *to, unsigned count);

#endif
