/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "matcher.h"

#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "kernel.h"

/* ---- Variants ---- */

#if defined __x86_64__ || defined __i386__
const struct kernel *const *kernel_available(void) {
    static const struct kernel *found[5];
    int n = 0;

    found[n++] = &kernel_scalar;
    __builtin_cpu_init();
    if (__builtin_cpu_supports("mmx"))
        found[n++] = &kernel_mmx;
    if (__builtin_cpu_supports("sse2"))
        found[n++] = &kernel_sse2;
    if (__builtin_cpu_supports("avx2"))
        found[n++] = &kernel_avx2;
    return found;
}
#else
const struct kernel *const *kernel_available(void) {
    static const struct kernel *const found[] = {&kernel_scalar, NULL};

    return found;
}
#endif

/* ---- Filter ---- */

/* Turns winners into reliable disparities. */

#define NEAR (2 * MATCHER_SUBPIXEL) /* neighbours that differ by at most this belong to one patch */
#define NONE (-1)

struct filter {
    int width, height, disparities, agreement, speckle;
    int16_t *seen;    /* of each pixel of the right picture: the disparity that the left one found, or NONE */
    uint8_t *cost;    /* the cost of that disparity */
    uint32_t *run[2]; /* of each pixel of this row and the last one: its run of similar neighbours */
    uint32_t *parent; /* of each run: another one of the same patch, itself at the root */
    uint32_t *size;   /* of a root: pixels of the patch */
};

static void filter_free(struct filter *filter) {
    if (!filter)
        return;
    free(filter->seen);
    free(filter->cost);
    free(filter->run[0]);
    free(filter->parent);
    free(filter->size);
    free(filter);
}

/* NULL: no memory. */
static struct filter *filter_new(const struct matcher_settings *settings) {
    struct filter *filter = calloc(1, sizeof *filter);
    size_t width = (size_t)settings->width, pixels = width * (size_t)settings->height;

    if (!filter)
        return NULL;
    filter->width = settings->width;
    filter->height = settings->height;
    filter->disparities = settings->disparities;
    filter->agreement = settings->agreement;
    filter->speckle = settings->speckle;
    filter->seen = malloc(width * sizeof *filter->seen);
    filter->cost = malloc(width);
    filter->run[0] = malloc(2 * width * sizeof *filter->run[0]);
    filter->run[1] = filter->run[0] ? filter->run[0] + width : NULL;
    filter->parent = malloc(pixels * sizeof *filter->parent);
    filter->size = malloc(pixels * sizeof *filter->size);
    if (filter->seen && filter->cost && filter->run[0] && filter->parent && filter->size)
        return filter;
    filter_free(filter);
    return NULL;
}

/* ---- A row ---- */

/* The bottom of the parabola through three costs, up to half a pixel to either side; rounded. */
static int refined(const struct kernel_winner *winner, int disparities) {
    int at = winner->disparity * MATCHER_SUBPIXEL, half = MATCHER_SUBPIXEL / 2;
    int bend = winner->before + winner->after - 2 * winner->cost;

    if (winner->disparity + 1 == disparities || bend <= 0)
        return at;
    return at + (int)((unsigned)(half * (winner->before - winner->after + bend) + bend / 2) / (unsigned)bend) - half;
}

/* The right picture's view: of all left pixels that match one right pixel, the one with the least cost. */
static void look_from_right(struct filter *filter, const struct kernel_winner *winner) {
    memset(filter->cost, 255, (size_t)filter->width);
    for (int x = 0; x < filter->width; x++)
        filter->seen[x] = NONE;
    for (int x = 0; x < filter->width; x++) {
        int at = x - winner[x].disparity;

        if (at >= 0 && winner[x].cost < filter->cost[at]) {
            filter->cost[at] = winner[x].cost;
            filter->seen[at] = winner[x].disparity;
        }
    }
}

static bool is_contradicted(const struct filter *filter, int x, int disparity) {
    int at = x - disparity;

    return at >= 0 && filter->seen[at] != NONE && abs(filter->seen[at] - disparity) > filter->agreement;
}

/* A row's disparities, in parts of a pixel; 0 where the winner has rivals, or the right picture does not agree. */
static void filter_row(struct filter *filter, const struct kernel_winner *winner, uint16_t *disparity) {
    look_from_right(filter, winner);
    for (int x = 0; x < filter->width; x++) {
        int best = winner[x].disparity, found = refined(&winner[x], filter->disparities);

        if (!best || x < best || winner[x].rivals ||
            (is_contradicted(filter, x, found / MATCHER_SUBPIXEL) &&
             is_contradicted(filter, x, (found + MATCHER_SUBPIXEL - 1) / MATCHER_SUBPIXEL)))
            found = 0;
        disparity[x] = (uint16_t)found;
    }
}

/* ---- Speckles ---- */

static uint32_t root(uint32_t *parent, uint32_t run) {
    while (parent[run] != run)
        run = parent[run] = parent[parent[run]];
    return run;
}

static void join(struct filter *filter, uint32_t a, uint32_t b) {
    a = root(filter->parent, a);
    b = root(filter->parent, b);
    if (a == b)
        return;
    uint32_t low = a < b ? a : b, high = a < b ? b : a;
    filter->parent[high] = low;
    filter->size[low] += filter->size[high];
}

static bool is_alike(uint16_t a, uint16_t b) {
    return a && b && abs(a - b) <= NEAR;
}

/* The end of the run that begins at x: the first pixel that differs from its left neighbour. */
static int run_end(const uint16_t *row, int x, int width) {
    do
        x++;
    while (x < width && is_alike(row[x - 1], row[x]));
    return x;
}

/* Numbers the runs of a row from `next` on, and joins runs that touch in neighbouring rows. */
static uint32_t find_runs(struct filter *filter, const uint16_t *row, const uint16_t *above, const uint32_t *runs_above,
                          uint32_t *runs, uint32_t next) {
    for (int x = 0, end; x < filter->width; x = end, next++) {
        end = run_end(row, x, filter->width);
        filter->parent[next] = next;
        filter->size[next] = (uint32_t)(end - x);
        uint32_t joined = UINT32_MAX;
        for (int i = x; i < end; i++) {
            runs[i] = next;
            if (above && runs_above[i] != joined && is_alike(above[i], row[i]))
                join(filter, joined = runs_above[i], next);
        }
    }
    return next;
}

/* Sets small patches whose disparity differs from their surroundings to 0, in the whole picture. */
static void filter_speckles(struct filter *filter, uint16_t *disparity) {
    uint32_t run = 0;

    if (!filter->speckle)
        return;
    for (int y = 0; y < filter->height; y++) {
        uint16_t *row = disparity + (long)y * filter->width;

        run = find_runs(filter, row, y ? row - filter->width : NULL, filter->run[(y + 1) & 1], filter->run[y & 1], run);
    }
    run = 0;
    for (int y = 0; y < filter->height; y++) {
        uint16_t *row = disparity + (long)y * filter->width;

        for (int x = 0, end; x < filter->width; x = end, run++) {
            end = run_end(row, x, filter->width);
            if (filter->size[root(filter->parent, run)] < (uint32_t)filter->speckle)
                memset(row + x, 0, (size_t)(end - x) * sizeof *row);
        }
    }
}

/* ---- Matcher ---- */

struct matcher {
    struct matcher_settings settings;
    const struct kernel *kernel;
    uint8_t limit[256];
    int lanes;        /* of a pixel */
    long right_width; /* of a row of the right census, with the bytes beside the picture */
    uint8_t unused[KERNEL_LANES];
    uint8_t *left, *right;                  /* census: three planes of a row, then the next row */
    uint8_t *cost, *vertical, *least, *sum; /* sum: of all rows */
    struct kernel_winner *winner;
    struct filter *filter;
};

static const struct kernel *kernel_chosen(const char *name) {
    const struct kernel *const *kernels = kernel_available(), *chosen = NULL;

    for (; *kernels; kernels++)
        if (!name || !strcmp((*kernels)->name, name))
            chosen = *kernels;
    return chosen;
}

/* Rows are read in whole vectors, which may reach beyond their ends. */
static uint8_t *bytes(size_t count) {
    size_t size = (count + 2 * KERNEL_ALIGN) / KERNEL_ALIGN * KERNEL_ALIGN;
    uint8_t *at = aligned_alloc(KERNEL_ALIGN, size);

    return at ? memset(at, 0, size) : NULL;
}

static bool allocate(struct matcher *matcher) {
    const struct matcher_settings *settings = &matcher->settings;
    size_t width = (size_t)settings->width, height = (size_t)settings->height, row = width * (size_t)matcher->lanes;

    matcher->left = bytes(KERNEL_PLANES * width * height);
    matcher->right = bytes(KERNEL_PLANES * (size_t)matcher->right_width * height);
    matcher->cost = bytes(row);
    matcher->vertical = bytes(row);
    matcher->least = bytes(width);
    matcher->sum = bytes(row * height);
    matcher->winner = malloc(width * sizeof *matcher->winner);
    matcher->filter = filter_new(settings);
    return matcher->left && matcher->right && matcher->cost && matcher->vertical && matcher->least && matcher->sum &&
           matcher->winner && matcher->filter;
}

static bool settings_fit(const struct matcher_settings *settings) {
    return settings->width >= MATCHER_LEAST_WIDTH && settings->height >= MATCHER_LEAST_HEIGHT &&
           settings->disparities >= KERNEL_STEP && settings->disparities <= KERNEL_DISPARITIES &&
           settings->disparities % KERNEL_STEP == 0 && settings->disparities <= settings->width &&
           settings->uniqueness >= 0 && settings->uniqueness < 100;
}

struct matcher *matcher_new(const struct matcher_settings *settings) {
    const struct kernel *kernel = kernel_chosen(settings->variant);

    if (!settings_fit(settings) || !kernel) {
        errno = kernel ? EINVAL : ENOSYS;
        return NULL;
    }
    struct matcher *matcher = calloc(1, sizeof *matcher);
    if (!matcher)
        return NULL;
    matcher->settings = *settings;
    matcher->kernel = kernel;
    matcher->lanes = (settings->disparities + kernel->step - 1) / kernel->step * kernel->step;
    matcher->right_width = matcher->lanes + settings->width;
    memset(matcher->unused, KERNEL_UNUSED, (size_t)(matcher->lanes - settings->disparities));
    for (int i = 0; i < 256; i++) {
        int limit = i * 100 / (100 - settings->uniqueness);
        matcher->limit[i] = (uint8_t)(limit < 254 ? limit : 254);
    }
    if (!allocate(matcher)) {
        matcher_free(matcher);
        errno = ENOMEM;
        return NULL;
    }
    return matcher;
}

void matcher_free(struct matcher *matcher) {
    if (!matcher)
        return;
    free(matcher->left);
    free(matcher->right);
    free(matcher->cost);
    free(matcher->vertical);
    free(matcher->least);
    free(matcher->sum);
    free(matcher->winner);
    filter_free(matcher->filter);
    free(matcher);
}

const char *matcher_variant(const struct matcher *matcher) {
    return matcher->kernel->name;
}

/* Five rows around row y; at the edge a row is repeated. */
static void rows_around(const uint8_t *picture, long stride, int y, int height, const uint8_t *row[5]) {
    for (int i = 0; i < 5; i++) {
        int at = y + i - 2;

        row[i] = picture + stride * (at < 0 ? 0 : at >= height ? height - 1 : at);
    }
}

static struct kernel_row row_at(const struct matcher *matcher, int y) {
    int width = matcher->settings.width, lanes = matcher->lanes;
    struct kernel_row row = {.width = width,
                             .lanes = lanes,
                             .unused = matcher->unused,
                             .cost = matcher->cost,
                             .vertical = matcher->vertical,
                             .least = matcher->least,
                             .sum = matcher->sum + (size_t)y * (size_t)width * (size_t)lanes};

    for (int i = 0; i < KERNEL_PLANES; i++) {
        row.left[i] = matcher->left + (KERNEL_PLANES * (long)y + i) * width;
        row.right[i] = matcher->right + (KERNEL_PLANES * (long)y + i) * matcher->right_width;
    }
    return row;
}

static void census(struct matcher *matcher, const uint8_t *left, long left_stride, const uint8_t *right,
                   long right_stride, int y) {
    int width = matcher->settings.width, height = matcher->settings.height;
    uint8_t *to_left[KERNEL_PLANES], *to_right[KERNEL_PLANES];
    const uint8_t *row[5];

    for (int i = 0; i < KERNEL_PLANES; i++) {
        to_left[i] = matcher->left + (KERNEL_PLANES * (long)y + i) * width;
        to_right[i] = matcher->right + (KERNEL_PLANES * (long)y + i) * matcher->right_width + matcher->lanes - 1;
    }
    rows_around(left, left_stride, y, height, row);
    matcher->kernel->census(row, width, to_left);
    rows_around(right, right_stride, y, height, row);
    matcher->kernel->census(row, width, to_right);
}

static void vertical_begin(struct matcher *matcher) {
    memset(matcher->vertical, 0, (size_t)matcher->settings.width * (size_t)matcher->lanes);
    memset(matcher->least, 0, (size_t)matcher->settings.width);
}

void matcher_run(struct matcher *matcher, const uint8_t *left, long left_stride, const uint8_t *right,
                 long right_stride, uint16_t *disparity) {
    int height = matcher->settings.height;

    vertical_begin(matcher);
    for (int y = 0; y < height; y++) {
        census(matcher, left, left_stride, right, right_stride, y);
        struct kernel_row row = row_at(matcher, y);
        matcher->kernel->forward(&row);
    }
    vertical_begin(matcher);
    for (int y = height - 1; y >= 0; y--) {
        struct kernel_row row = row_at(matcher, y);

        matcher->kernel->backward(&row, matcher->limit, matcher->winner);
        filter_row(matcher->filter, matcher->winner, disparity + (long)y * matcher->settings.width);
    }
    filter_speckles(matcher->filter, disparity);
}
