/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Reduces fractions: frame rates and pixel aspects. */
#ifndef DDXVIDEO_FRACTION_H
#define DDXVIDEO_FRACTION_H

#include <stdint.h>

/* Greatest common divisor; a, b >= 0, not both 0. */
int64_t fraction_divisor(int64_t a, int64_t b);

/*
 * Reduce to lowest terms. If a part then does not fit into an int, both are halved until they fit, which changes the
 * eighth digit. Neither may be negative.
 */
void fraction_reduce(int64_t *num, int64_t *den);

/* The same, with two ints as the result. */
void fraction_set(int *num, int *den, int64_t n, int64_t d);

#endif
