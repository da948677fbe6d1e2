/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Each variant of the matcher gives the same bits as a plain model, written from the description of the method. */
#include <errno.h>

#include "check.h"
#include "kernel.h"
#include "matcher.h"

#define SIDE 200
#define UNKNOWN 0

static uint8_t left[SIDE * SIDE], right[SIDE * SIDE];
static uint16_t expected[SIDE * SIDE], found[SIDE * SIDE];
static int cost[SIDE][SIDE][KERNEL_DISPARITIES], sum[SIDE][SIDE][KERNEL_DISPARITIES], path[2][SIDE][KERNEL_DISPARITIES];
static unsigned seed = 1;

static unsigned roll(unsigned sides) {
    seed = seed * 1664525u + 1013904223u;
    return (seed >> 8) % sides;
}

/* ---- The model ---- */

static unsigned model_census(const uint8_t *picture, int width, int height, int x, int y) {
    unsigned bits = 0, n = 0;

    if (x < 2 || x >= width - 2)
        return 0;
    for (int dy = -2; dy <= 2; dy++)
        for (int dx = -2; dx <= 2; dx++) {
            int at = y + dy < 0 ? 0 : y + dy >= height ? height - 1 : y + dy;

            if (dx || dy)
                bits |= (unsigned)(picture[at * width + x + dx] < picture[y * width + x]) << n++;
        }
    return bits;
}

static void model_costs(const struct matcher_settings *s) {
    for (int y = 0; y < s->height; y++)
        for (int x = 0; x < s->width; x++)
            for (int d = 0; d < s->disparities; d++) {
                unsigned a = model_census(left, s->width, s->height, x, y);
                unsigned b = x < d ? 0 : model_census(right, s->width, s->height, x - d, y);

                cost[y][x][d] = __builtin_popcount(a ^ b);
            }
}

/* Add one pixel of a path to the sum; `last` is NULL where the path begins. */
static void model_step(int x, int y, int disparities, const int *last, int *now) {
    int least = last ? last[0] : 0;

    for (int d = 1; last && d < disparities; d++)
        least = last[d] < least ? last[d] : least;
    for (int d = 0; d < disparities; d++) {
        int best = last ? least + KERNEL_LARGE : 0;

        if (last && last[d] < best)
            best = last[d];
        if (last && d > 0 && last[d - 1] + KERNEL_SMALL < best)
            best = last[d - 1] + KERNEL_SMALL;
        if (last && d < disparities - 1 && last[d + 1] + KERNEL_SMALL < best)
            best = last[d + 1] + KERNEL_SMALL;
        now[d] = cost[y][x][d] + best - least;
        sum[y][x][d] += now[d];
    }
}

static void model_paths(const struct matcher_settings *s) {
    memset(sum, 0, sizeof sum);
    for (int y = 0; y < s->height; y++)
        for (int back = 0; back < 2; back++)
            for (int i = 0; i < s->width; i++)
                model_step(back ? s->width - 1 - i : i, y, s->disparities, i ? path[(i + 1) & 1][0] : NULL,
                           path[i & 1][0]);
    for (int x = 0; x < s->width; x++)
        for (int back = 0; back < 2; back++)
            for (int i = 0; i < s->height; i++)
                model_step(x, back ? s->height - 1 - i : i, s->disparities, i ? path[(i + 1) & 1][0] : NULL,
                           path[i & 1][0]);
}

static int model_winner(const int *sums, int disparities) {
    int best = 0;

    for (int d = 1; d < disparities; d++)
        best = sums[d] < sums[best] ? d : best;
    return best;
}

static int model_unique(const struct matcher_settings *s, const int *sums, int best) {
    int limit = sums[best] * 100 / (100 - s->uniqueness);

    for (int d = 0; d < s->disparities; d++)
        if (abs(d - best) > 1 && sums[d] <= (limit < 254 ? limit : 254))
            return 0;
    return 1;
}

static int model_refined(const struct matcher_settings *s, const int *sums, int best) {
    if (best == 0 || best == s->disparities - 1)
        return best * 16;
    int before = sums[best - 1] - sums[best], after = sums[best + 1] - sums[best];
    return before + after ? best * 16 - 8 + (16 * before + (before + after) / 2) / (before + after) : best * 16;
}

/* Whether the right picture confirms this disparity of the left one's pixel x. */
static int model_agrees(const struct matcher_settings *s, int y, int x, int disparity) {
    int least = INT32_MAX, seen = disparity, at = x - disparity;

    for (int i = 0; at >= 0 && i < s->width; i++) {
        int best = model_winner(sum[y][i], s->disparities);

        if (i - best == at && sum[y][i][best] < least) {
            least = sum[y][i][best];
            seen = best;
        }
    }
    return abs(seen - disparity) <= s->agreement;
}

static int model_patch(const struct matcher_settings *s, const uint16_t *map, uint8_t *visited, int x, int y) {
    static const int aside[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
    int size = 1;

    visited[y * s->width + x] = 1;
    for (int i = 0; i < 4; i++) {
        int u = x + aside[i][0], v = y + aside[i][1];

        if (u >= 0 && u < s->width && v >= 0 && v < s->height && !visited[v * s->width + u] && map[v * s->width + u] &&
            abs(map[v * s->width + u] - map[y * s->width + x]) <= 32)
            size += model_patch(s, map, visited, u, v);
    }
    return size;
}

static void model(const struct matcher_settings *s) {
    static uint16_t map[SIDE * SIDE];
    static uint8_t visited[SIDE * SIDE];

    model_costs(s);
    model_paths(s);
    for (int y = 0; y < s->height; y++)
        for (int x = 0; x < s->width; x++) {
            const int *sums = sum[y][x];
            int best = model_winner(sums, s->disparities), refined = model_refined(s, sums, best);
            int known = best && best <= x && model_unique(s, sums, best) &&
                        (model_agrees(s, y, x, refined / 16) || model_agrees(s, y, x, (refined + 15) / 16));

            map[y * s->width + x] = known ? (uint16_t)refined : UNKNOWN;
        }
    memcpy(expected, map, sizeof expected);
    for (int at = 0; s->speckle && at < s->width * s->height; at++) {
        memset(visited, 0, sizeof visited);
        if (map[at] && model_patch(s, map, visited, at % s->width, at / s->width) < s->speckle)
            expected[at] = UNKNOWN;
    }
}

/* ---- Pictures ---- */

/* The right picture has the left one's pixels `disparity` to the left, three pixels less in the lower half; every
 * `noise`th pixel of the right picture differs. */
static void draw(const struct matcher_settings *s, int disparity, unsigned noise) {
    for (int i = 0; i < s->width * s->height; i++) {
        left[i] = (uint8_t)roll(256);
        right[i] = (uint8_t)roll(256);
    }
    for (int y = 0; y < s->height; y++)
        for (int x = 0; x < s->width; x++) {
            int from = x + disparity - (y >= s->height / 2 ? 3 : 0);

            if (from < s->width && !(noise && roll(noise) == 0))
                right[y * s->width + x] = left[y * s->width + from];
        }
}

static void run(const struct matcher_settings *settings, const char *variant) {
    struct matcher_settings of_variant = *settings;

    of_variant.variant = variant;
    struct matcher *matcher = matcher_new(&of_variant);
    CHECK(matcher);
    CHECK(!strcmp(matcher_variant(matcher), variant));
    for (int pass = 0; pass < 2; pass++) { /* the second pass must not depend on the first */
        memset(found, 0xee, sizeof found);
        matcher_run(matcher, left, settings->width, right, settings->width, found);
        for (int i = 0; i < settings->width * settings->height; i++)
            if (found[i] != expected[i]) {
                fprintf(stderr, "%s, %dx%d, %d disparities, at %d,%d: %d, not %d\n", variant, settings->width,
                        settings->height, settings->disparities, i % settings->width, i / settings->width, found[i],
                        expected[i]);
                exit(1);
            }
    }
    matcher_free(matcher);
}

static void test_bits(void) {
    static const struct {
        struct matcher_settings settings;
        int disparity;
        unsigned noise;
    } cases[] = {
        {{64, 5, 16, 5, 1, 0, NULL}, 7, 0},
        {{67, 9, 32, 0, 1, 10, NULL}, 20, 5},
        {{97, 12, 48, 5, 1, 20, NULL}, 40, 6},
        {{131, 21, 64, 5, 0, 50, NULL}, 33, 4},
        {{120, 11, 80, 10, 1, 30, NULL}, 64, 7},
        {{129, 14, 112, 5, 2, 50, NULL}, 90, 8},
        {{180, 8, 144, 3, 1, 8, NULL}, 120, 9},
        {{199, 7, 192, 5, 1, 5, NULL}, 100, 3},
        /* beyond the searched disparities: the lanes that pad a vector must not find it */
        {{140, 10, 48, 5, 1, 0, NULL}, 56, 0},
        {{190, 8, 112, 5, 1, 0, NULL}, 121, 0},
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        draw(&cases[i].settings, cases[i].disparity, cases[i].noise);
        model(&cases[i].settings);
        for (const struct kernel *const *kernel = kernel_available(); *kernel; kernel++)
            run(&cases[i].settings, (*kernel)->name);
    }
}

/* The largest number of disparities needs a wide picture, for which the model would be too slow. */
static void test_most(void) {
    enum { WIDTH = 300, HEIGHT = 12 };
    const struct matcher_settings settings = {WIDTH, HEIGHT, 256, 5, 1, 0, NULL};
    uint16_t first[WIDTH * HEIGHT], other[WIDTH * HEIGHT];

    draw(&settings, 250, 0);
    for (const struct kernel *const *kernel = kernel_available(); *kernel; kernel++) {
        struct matcher_settings of_variant = settings;
        of_variant.variant = (*kernel)->name;
        struct matcher *matcher = matcher_new(&of_variant);
        CHECK(matcher);
        matcher_run(matcher, left, WIDTH, right, WIDTH, *kernel == kernel_available()[0] ? first : other);
        matcher_free(matcher);
        if (*kernel != kernel_available()[0])
            CHECK(!memcmp(first, other, sizeof first));
    }
    CHECK_EQUAL((first[1 * WIDTH + 280] + 8) / 16, 250);
    CHECK_EQUAL((first[10 * WIDTH + 280] + 8) / 16, 247);
}

/* A shift without noise is found everywhere but at the edges. */
static void test_known_shift(void) {
    const struct matcher_settings settings = {160, 40, 32, 5, 1, 50, NULL};
    struct matcher *matcher = matcher_new(&settings);
    int right_ones = 0;

    draw(&settings, 12, 0);
    matcher_run(matcher, left, 160, right, 160, found);
    for (int y = 0; y < 40; y++)
        for (int x = 20; x < 150; x++)
            right_ones += abs(found[y * 160 + x] - (y < 20 ? 12 : 9) * 16) < 8;
    CHECK(right_ones >= 40 * 130 * 98 / 100);
    matcher_free(matcher);
}

static void refused(struct matcher_settings settings, int error) {
    errno = 0;
    CHECK(!matcher_new(&settings));
    CHECK_EQUAL(errno, error);
}

static void test_refused(void) {
    refused((struct matcher_settings){63, 48, 32, 5, 1, 50, NULL}, EINVAL);
    refused((struct matcher_settings){64, 4, 32, 5, 1, 50, NULL}, EINVAL);
    refused((struct matcher_settings){64, 48, 0, 5, 1, 50, NULL}, EINVAL);
    refused((struct matcher_settings){64, 48, 40, 5, 1, 50, NULL}, EINVAL);
    refused((struct matcher_settings){64, 48, 80, 5, 1, 50, NULL}, EINVAL);
    refused((struct matcher_settings){320, 48, 272, 5, 1, 50, NULL}, EINVAL);
    refused((struct matcher_settings){64, 48, 32, 100, 1, 50, NULL}, EINVAL);
    refused((struct matcher_settings){64, 48, 32, 5, 1, 50, "sse9"}, ENOSYS);
}

int main(void) {
    test_bits();
    test_most();
    test_known_shift();
    test_refused();
    return 0;
}
