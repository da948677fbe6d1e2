/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Gives pairs: from one item with two stacked fields, or from two items whose frames are paired by capture time.
 *
 * Of two frames that are no pair, the older one is given up (lost.pair). A frame that waits for the other camera is
 * given up after 0.2 s and two periods, so that counters and messages continue while one camera is gone.
 */
#ifndef DDXVIDEO_STEREO_SOURCE_H
#define DDXVIDEO_STEREO_SOURCE_H

#include <program.h>
#include <stdint.h>

#include "calibration.h"
#include "ddxvideo.h"

struct luma {
    const uint8_t *at;
    long stride;
    uint8_t *made; /* for pictures without a luminance plane */
    size_t size;
};

/* A table from samples to full range. */
void luma_levels(int range, uint8_t level[256]);

/* Reasons for losses, in the order of the names in ddx_stats_open(). */
enum { LOST_LATE, LOST_PAIR, LOST_PICTURE, LOST_STORE };

struct source_item {
    const char *name;
    DDX_STORE_ITEM *item;
    bool awaited, begun, held;
    struct ddx_frame frame;
    struct ddxvideo_picture picture;
    struct luma luma;
    int64_t time; /* of the capture */
};

struct source {
    /* Set before source_open(): */
    const char *name[2]; /* of the items, left and right; second NULL: the first has both fields */
    enum eye top;        /* the eye of a single item's upper field */
    int64_t window;      /* maximum difference of times in a pair, ns; 0: half a frame period */
    DDX_STATS_BOOK *book;
    /* Private, 0 at first: */
    struct source_item item[2];
    int items;
    unsigned unpaired; /* frames without a partner that were given up since the last pair */
    bool said;         /* the lack of pairs was reported */
    int64_t last_pair; /* time of the last pair, or of the start */
};

/* A pair, valid until source_give(). */
struct pair {
    const uint8_t *luma[2]; /* left and right */
    long stride[2];
    struct ddxvideo_geometry geometry; /* of one eye's picture */
    struct ddxvideo_stamp stamp;
    int64_t written; /* write time of its later frame */
    unsigned frames; /* of the input */
};

/* False, after a line, if an item cannot be read; also if a stop is requested. */
bool source_open(struct source *source, DDX_STORE_ID *id);

/*
 * Wait at most `wait` seconds for the next pair. Counts frames as in, and frames without a partner as lost; the caller
 * counts the pair's frames. 0; -EAGAIN: no pair yet; otherwise the store's error, which is final: *at is the item's
 * name.
 */
int source_take(struct source *source, double wait, struct pair *pair, const char **at);

/* Release the pair. */
void source_give(struct source *source);

/* Stop taking pairs: a frame that waits for its partner becomes lost.pair. */
void source_end(struct source *source);

void source_close(struct source *source);

#endif
