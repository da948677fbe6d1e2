/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "filter.h"

#include <stdlib.h>
#include <string.h>

#define NEAR (2 * MATCHER_SUBPIXEL) /* neighbours that differ by at most this belong to one patch */
#define NONE (-1)

struct filter {
    int width, height, disparities, agreement, speckle;
    int16_t *seen;       /* of each pixel of the right picture: the disparity that the left one found, or NONE */
    uint8_t *cost;       /* the cost of that disparity */
    uint32_t *run[2];    /* of each pixel of this row and the last one: its run of similar neighbours */
    uint32_t *parent;    /* of each run: another one of the same patch, itself at the root */
    uint32_t *size;      /* of a root: pixels of the patch */
};

struct filter *filter_new(const struct matcher_settings *settings) {
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

void filter_free(struct filter *filter) {
    if (!filter)
        return;
    free(filter->seen);
    free(filter->cost);
    free(filter->run[0]);
    free(filter->parent);
    free(filter->size);
    free(filter);
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

static bool disagrees(const struct filter *filter, int x, int disparity) {
    int at = x - disparity;

    return at >= 0 && filter->seen[at] != NONE && abs(filter->seen[at] - disparity) > filter->agreement;
}

void filter_row(struct filter *filter, const struct kernel_winner *winner, uint16_t *disparity) {
    look_from_right(filter, winner);
    for (int x = 0; x < filter->width; x++) {
        int best = winner[x].disparity, found = refined(&winner[x], filter->disparities);

        if (!best || x < best || winner[x].rivals ||
            (disagrees(filter, x, found / MATCHER_SUBPIXEL) &&
             disagrees(filter, x, (found + MATCHER_SUBPIXEL - 1) / MATCHER_SUBPIXEL)))
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

static bool alike(uint16_t a, uint16_t b) {
    return a && b && abs(a - b) <= NEAR;
}

/* The end of the run that begins at x: the first pixel that differs from its left neighbour. */
static int run_end(const uint16_t *row, int x, int width) {
    do
        x++;
    while (x < width && alike(row[x - 1], row[x]));
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
            if (above && runs_above[i] != joined && alike(above[i], row[i]))
                join(filter, joined = runs_above[i], next);
        }
    }
    return next;
}

void filter_speckles(struct filter *filter, uint16_t *disparity) {
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
