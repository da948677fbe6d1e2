/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Reduces fractions: frame rates and pixel aspects. */
#ifndef DDXVIDEO_FRACTION_H
#define DDXVIDEO_FRACTION_H

#include <stdint.h>

/* Greatest common divisor; a, b >= 0, not both 0. */
static inline int64_t fraction_divisor(int64_t a, int64_t b) {
    while (b) {
        int64_t rest = a % b;

        a = b;
        b = rest;
    }
    return a;
}

/*
 * Reduce to lowest terms. If a part then does not fit into an int, both are halved until they fit, which changes the
 * eighth digit. Neither may be negative.
 */
static inline void fraction_reduce(int64_t *num, int64_t *den) {
    int64_t divisor = *num && *den ? fraction_divisor(*num, *den) : 1;

    *num /= divisor;
    *den /= divisor;
    while (*num > INT32_MAX || *den > INT32_MAX) {
        *num = (*num + 1) / 2;
        *den = (*den + 1) / 2;
    }
}

/* The same, with two ints as the result. */
static inline void fraction_set(int *num, int *den, int64_t n, int64_t d) {
    fraction_reduce(&n, &d);
    *num = (int)n;
    *den = (int)d;
}

#endif
