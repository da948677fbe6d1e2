/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The body of each variant. The file that includes it defines VARIANT, the type `vector` of LANES bytes, and of it:
 *   load store splat add sub both either differ least_of equal (255 or 0)
 *   add_sat, sub_sat       no more than 255, no less than 0
 *   shift_right(v, bits)   possibly of words larger than bytes: the caller masks
 *   enter(v, low)          one lane up; the lowest one is the highest of `low`
 *   leave(v, high)         one lane down; the highest one is the lowest of `high`
 *   least_splat(v)         the least lane, in all lanes
 *   lowest(v)              the lowest lane
 *   last_equal(bytes, count, byte), count_at_most(bytes, count, byte)
 *   done()                 to be called after the last vector
 */
#include <string.h>

#include "kernel.h"

#define UNUSED (LANES > KERNEL_STEP) /* whether a row can have surplus lanes */
#define INLINE static inline __attribute__((always_inline))

/* How many bits of three planes are set: 24 at most. */
#ifndef bits_set
INLINE vector nibble_pairs(vector v) {
    v = sub(v, both(shift_right(v, 1), splat(0x55)));
    return add(both(v, splat(0x33)), both(shift_right(v, 2), splat(0x33)));
}

INLINE vector bits_set(vector a, vector b, vector c) {
    vector bits = add(add(nibble_pairs(a), nibble_pairs(b)), nibble_pairs(c)); /* 12 at most in each half of a byte */

    return add(both(bits, splat(0x0f)), both(shift_right(bits, 4), splat(0x0f)));
}
#endif

/* Costs of all disparities of the pixel x. Surplus lanes, below `row->unused`, cost more than any disparity. */
INLINE void costs(const struct kernel_row *row, int x, uint8_t *to, int lanes) {
    const vector left[KERNEL_PLANES] = {splat(row->left[0][x]), splat(row->left[1][x]), splat(row->left[2][x])};

    for (int i = 0; i < lanes; i += LANES) {
        vector bits =
            bits_set(differ(left[0], load(row->right[0] + x + i)), differ(left[1], load(row->right[1] + x + i)),
                     differ(left[2], load(row->right[2] + x + i)));

        if (UNUSED && !i)
            bits = either(bits, load(row->unused));
        store(to + i, bits);
    }
}

/* A pixel's costs along a path, from the previous pixel's costs and their least. Both arrays may be the same. */
INLINE vector along(const uint8_t *from, vector least, const uint8_t *cost, uint8_t *to, int lanes) {
    vector limit = add(least, splat(KERNEL_LARGE)), before = splat(255), here = load(from), now_least = splat(255);

    for (int i = 0; i < lanes; i += LANES) {
        vector next = i + LANES < lanes ? load(from + i + LANES) : splat(255);
        vector aside = add_sat(least_of(enter(here, before), leave(here, next)), splat(KERNEL_SMALL));
        vector now = add(sub(least_of(least_of(here, limit), aside), least), load(cost + i));

        store(to + i, now);
        now_least = least_of(now_least, now);
        before = here;
        here = next;
    }
    return least_splat(now_least);
}

INLINE void forward(const struct kernel_row *row, int lanes) {
    uint8_t path[KERNEL_LANES] __attribute__((aligned(KERNEL_ALIGN)));
    vector least = splat(0);

    memset(path, 0, sizeof path);
    for (int x = 0; x < row->width; x++) {
        uint8_t *to = row->sum + (long)x * lanes, *cost = row->cost + (long)x * lanes;

        costs(row, x, cost, lanes);
        least = along(x ? to - lanes : path, least, cost, to, lanes);
    }
    least = splat(0);
    for (int x = row->width - 1; x >= 0; x--) {
        uint8_t *to = row->sum + (long)x * lanes, *down = row->vertical + (long)x * lanes;
        const uint8_t *cost = row->cost + (long)x * lanes;

        least = along(path, least, cost, path, lanes);
        row->least[x] = lowest(along(down, splat(row->least[x]), cost, down, lanes));
        for (int i = 0; i < lanes; i += LANES)
            store(to + i, add_sat(load(to + i), add(load(path + i), load(down + i))));
    }
}

INLINE struct kernel_winner winner_of(const uint8_t *sum, uint8_t least, const uint8_t limit[256], int lanes) {
    int best = last_equal(sum, lanes, least), rivals = count_at_most(sum, lanes, limit[least]) - 1;
    uint8_t before = best + 1 < lanes ? sum[best + 1] : 255, after = best ? sum[best - 1] : 255;

    rivals -= (before <= limit[least]) + (after <= limit[least]);
    return (struct kernel_winner){(uint8_t)(lanes - 1 - best), least, before, after, rivals > 0};
}

INLINE void backward(const struct kernel_row *row, const uint8_t limit[256], struct kernel_winner *winner, int lanes) {
    uint8_t cost[KERNEL_LANES] __attribute__((aligned(KERNEL_ALIGN)));
    uint8_t sum[KERNEL_LANES] __attribute__((aligned(KERNEL_ALIGN)));

    for (int x = 0; x < row->width; x++) {
        uint8_t *up = row->vertical + (long)x * lanes;
        const uint8_t *so_far = row->sum + (long)x * lanes;
        vector least = splat(255);

        costs(row, x, cost, lanes);
        row->least[x] = lowest(along(up, splat(row->least[x]), cost, up, lanes));
        for (int i = 0; i < lanes; i += LANES) {
            vector all = add_sat(load(so_far + i), load(up + i));

            store(sum + i, all);
            least = least_of(least, all);
        }
        winner[x] = winner_of(sum, lowest(least_splat(least)), limit, lanes);
    }
}

/* The compiler unrolls the loops over common numbers of lanes. */
#define CASES CASE(32) CASE(48) CASE(64) CASE(80) CASE(96) CASE(112) CASE(128)

static void forward_row(const struct kernel_row *row) {
    switch (row->lanes) {
#define CASE(n) \
    case n: forward(row, n); break;
        CASES
#undef CASE
    default: forward(row, row->lanes);
    }
    done();
}

static void backward_row(const struct kernel_row *row, const uint8_t limit[256], struct kernel_winner *winner) {
    switch (row->lanes) {
#define CASE(n) \
    case n: backward(row, limit, winner, n); break;
        CASES
#undef CASE
    default: backward(row, limit, winner, row->lanes);
    }
    done();
}

/* Sets the lanes in which `pixel` is darker than the middle. */
INLINE vector darker(vector middle, const uint8_t *pixel, uint8_t bit) {
    return sub(splat(bit), both(equal(sub_sat(middle, load(pixel)), splat(0)), splat(bit)));
}

INLINE void census_at(const uint8_t *const row[5], int x, uint8_t *const to[KERNEL_PLANES]) {
    vector middle = load(row[2] + x), plane[KERNEL_PLANES] = {splat(0), splat(0), splat(0)};

    for (int n = 0, place = 0; place < 25; place++) {
        if (place == 12)
            continue;
        plane[n / 8] = add(plane[n / 8], darker(middle, row[place / 5] + x + place % 5 - 2, (uint8_t)(1 << n % 8)));
        n++;
    }
    for (int i = 0; i < KERNEL_PLANES; i++)
        store(to[i] + x, plane[i]);
}

static void census_row(const uint8_t *const row[5], int width, uint8_t *const to[KERNEL_PLANES]) {
    int x = 2;

    for (; x + LANES <= width - 2; x += LANES)
        census_at(row, x, to);
    if (x < width - 2 && width - 2 - LANES >= 2)
        census_at(row, width - 2 - LANES, to);
    done();
    for (int i = 0; i < KERNEL_PLANES; i++)
        to[i][0] = to[i][1] = to[i][width - 2] = to[i][width - 1] = 0;
}

#define KERNEL_(name) kernel_##name
#define KERNEL(name) KERNEL_(name)
#define TEXT_(name) #name
#define TEXT(name) TEXT_(name)

const struct kernel KERNEL(VARIANT) = {
    TEXT(VARIANT), LANES > KERNEL_STEP ? LANES : KERNEL_STEP, census_row, forward_row, backward_row,
};
