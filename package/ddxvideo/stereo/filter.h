/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Turns winners into reliable disparities. */
#ifndef DDXVIDEO_STEREO_FILTER_H
#define DDXVIDEO_STEREO_FILTER_H

#include <stdbool.h>

#include "kernel.h"
#include "matcher_settings.h"

struct filter;

/* NULL: no memory. */
struct filter *filter_new(const struct matcher_settings *settings);
void filter_free(struct filter *filter);

/* A row's disparities, in parts of a pixel; 0 where the winner has rivals, or the right picture does not agree. */
void filter_row(struct filter *filter, const struct kernel_winner *winner, uint16_t *disparity);

/* Sets small patches whose disparity differs from their surroundings to 0, in the whole picture. */
void filter_speckles(struct filter *filter, uint16_t *disparity);

#endif
