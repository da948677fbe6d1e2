/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Range of an item whose pictures come from a stereo pair: the items NAME.disparity and NAME.stereo beside it. */
#ifndef DDXVIDEO_RANGE_H
#define DDXVIDEO_RANGE_H

#include "history.h"

struct range;

/* For the thread that reads the item. NULL: no memory. The store stays the caller's. */
struct range *range_open(DDX_STORE_ID *id, const char *name);
/* NULL is allowed. */
void range_close(struct range *range);

/* Add to the history what has come since; does not wait for a value, and looks for the items once a second. */
void range_take(struct range *range, struct history *history);

/* Metres at a pixel of a field of this size; 0: not known. */
double range_metres(const struct shot_depth *depth, int column, int row, int width, int height);

#endif
