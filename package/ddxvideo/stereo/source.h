/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Where pairs come from: one item with two stacked fields, or two items whose frames are paired by capture time.
 *
 * Of two frames that do not belong together, the older one is given up (lost.pair). A frame that waits for the other
 * camera is given up after 0.2 s and two periods, so that counters and messages go on while one camera is gone.
 */
#ifndef DDXVIDEO_STEREO_SOURCE_H
#define DDXVIDEO_STEREO_SOURCE_H

#include <program.h>

#include "calibration.h"
#include "luma.h"

/* Reasons of loss, in the order of the names given to ddx_stats_open(). */
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
    const char *name[2]; /* of the items, left and right; the second one NULL: the first has both fields */
    enum eye top;        /* which eye the upper field of one item is */
    int64_t window;      /* ns, between the times of a pair at most; 0: half a frame period */
    DDX_STATS_BOOK *book;
    /* Its own, 0 at first: */
    struct source_item item[2];
    int items;
    unsigned lonely;   /* frames given up since the last pair because none belongs to them */
    bool said;         /* that there are no pairs */
    int64_t last_pair; /* when there was one, or when it began */
};

/* A pair, valid until source_give(). */
struct pair {
    const uint8_t *luma[2]; /* left and right */
    long stride[2];
    struct ddxvideo_geometry geometry; /* of one eye's picture */
    struct ddxvideo_stamp stamp;
    int64_t written; /* when the later one of its frames was written */
    unsigned frames; /* of the input */
};

/* False, after a line, if an item cannot be read, or when told to stop. */
bool source_open(struct source *source, DDX_STORE_ID *id);

/*
 * The next pair; waits `wait` seconds at most. Frames are counted as in, those that make no pair as lost;
 * the caller counts those of the pair. 0; -EAGAIN, there is no pair yet; or the store's error, which is final: *at is
 * the item's name.
 */
int source_take(struct source *source, double wait, struct pair *pair, const char **at);

/* The pair is not looked at any more. */
void source_give(struct source *source);

/* No more are taken: a frame that waits for another one is lost.pair. */
void source_end(struct source *source);

void source_close(struct source *source);

#endif
