/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Frame rates and the shapes of pixels. */
#ifndef DDXVIDEO_FRACTION_H
#define DDXVIDEO_FRACTION_H

#include <stdint.h>

/* The largest number that divides both; a, b >= 0, not both 0. */
int64_t fraction_divisor(int64_t a, int64_t b);

/*
 * In lowest terms; what does not fit into an int then is halved until it does, which changes the eighth digit. Neither
 * is negative.
 */
void fraction_reduce(int64_t *num, int64_t *den);

/* The same, into a geometry's pair. */
void fraction_set(int *num, int *den, int64_t n, int64_t d);

#endif
