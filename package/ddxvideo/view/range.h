/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Range of an item with pictures of a stereo pair, from the items NAME.disparity and NAME.stereo. */
#ifndef DDXVIDEO_RANGE_H
#define DDXVIDEO_RANGE_H

#include "history.h"

struct range;

/* Used by the thread that reads the item. NULL: no memory. The store remains the caller's. */
struct range *range_open(DDX_STORE_ID *id, const char *name);
/* NULL is allowed. */
void range_close(struct range *range);

/* Add new values to the history. Does not wait for a value; looks for the items once a second. */
void range_take(struct range *range, struct history *history);

/* Metres at a pixel of a field of this size; 0: not known. */
double range_metres(const struct shot_depth *depth, int column, int row, int width, int height);

#endif
