/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The rows of the matcher: four variants with the same results, bit for bit. A processor runs the widest one that it
 * supports.
 *
 * A pixel's census has 24 bits in three planes of bytes. Cost of a disparity: the bits that differ, at most 24. Along
 * a path the cost is at most 24 + the larger penalty, so the sum of four paths fits into a byte.
 */
#ifndef DDXVIDEO_STEREO_KERNEL_H
#define DDXVIDEO_STEREO_KERNEL_H

#include <stdint.h>

#define KERNEL_ALIGN 64
#define KERNEL_DISPARITIES 256 /* the largest number */
#define KERNEL_STEP 16         /* the number of disparities is a multiple of this */
#define KERNEL_LANES KERNEL_DISPARITIES
#define KERNEL_UNUSED 64 /* its sum over four paths is above that of any disparity */
#define KERNEL_SMALL 7   /* penalty where the disparity changes by one along a path */
#define KERNEL_LARGE 36  /* where it changes by more; 4 * (24 + this) < 256 */
#define KERNEL_PLANES 3  /* of a census */

/*
 * A pixel has a lane for each disparity, the largest first: then lanes have the order of the right row's pixels, and
 * lane i of pixel x belongs to right[x + i]. `lanes` is the number of disparities, rounded up; surplus lanes come
 * first.
 */
struct kernel_row {
    int width, lanes;
    const uint8_t *left[KERNEL_PLANES];  /* census of the left row */
    const uint8_t *right[KERNEL_PLANES]; /* of the right row, after lanes - 1 bytes for pixels outside the picture */
    const uint8_t *unused;               /* of the first lanes: KERNEL_UNUSED without a disparity, otherwise 0 */
    uint8_t *cost;                       /* scratch: width * lanes */
    uint8_t *vertical, *least;           /* the vertical path: width * lanes, and each pixel's least cost */
    uint8_t *sum;                        /* sum of this row's paths so far: width * lanes */
};

struct kernel_winner {
    uint8_t disparity, cost, before, after; /* the best disparity, and its neighbours' costs (255: no neighbour) */
    uint8_t rivals;                         /* whether other disparities cost little more */
};

struct kernel {
    const char *name;
    int step; /* lanes are a multiple of this */
    /* Census of the middle row of five; 0 for the first two and the last two pixels. */
    void (*census)(const uint8_t *const row[5], int width, uint8_t *const to[KERNEL_PLANES]);
    /* From top to bottom: sets `sum` to the paths from left, right and above. */
    void (*forward)(const struct kernel_row *row);
    /* From bottom to top: adds the path from below, and finds each pixel's winner. limit[c]: the largest cost that
     * counts as little more than c. */
    void (*backward)(const struct kernel_row *row, const uint8_t limit[256], struct kernel_winner *winner);
};

extern const struct kernel kernel_scalar;
#if defined __x86_64__ || defined __i386__
extern const struct kernel kernel_mmx, kernel_sse2, kernel_avx2;
#endif

/* Every variant that this processor runs, the slowest first, NULL at the end. */
const struct kernel *const *kernel_available(void);

#endif
