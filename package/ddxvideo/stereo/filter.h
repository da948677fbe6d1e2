/* SPDX-License-Identifier: GPL-2.0-or-later */
/* From winners to disparities that can be relied on. */
#ifndef DDXVIDEO_STEREO_FILTER_H
#define DDXVIDEO_STEREO_FILTER_H

#include <stdbool.h>

#include "kernel.h"
#include "matcher_settings.h"

struct filter;

/* NULL: no memory. */
struct filter *filter_new(const struct matcher_settings *settings);
void filter_free(struct filter *filter);

/* A row's disparities, in parts of a pixel; 0 for a winner with rivals, and where the right picture does not agree. */
void filter_row(struct filter *filter, const struct kernel_winner *winner, uint16_t *disparity);

/* In the whole picture: 0 for small patches with another disparity than what is around them. */
void filter_speckles(struct filter *filter, uint16_t *disparity);

#endif
