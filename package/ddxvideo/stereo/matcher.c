/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "matcher.h"

#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "filter.h"
#include "kernel.h"

struct matcher {
    struct matcher_settings settings;
    const struct kernel *kernel;
    uint8_t limit[256];
    int lanes;                              /* of a pixel */
    long right_width;                       /* of a row of the right census, with the bytes beside the picture */
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
    struct kernel_row row = {.width = width, .lanes = lanes, .unused = matcher->unused, .cost = matcher->cost,
                             .vertical = matcher->vertical, .least = matcher->least,
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
