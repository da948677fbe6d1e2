/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "source.h"

#include <errno.h>
#include <stdlib.h>

#include "ddx_time.h"

/* ---- Luminance ---- */

/* The luminance of pictures of each layout, 8 bits a pixel. */

static void make_row(int format, const uint8_t *from, int width, uint8_t *to) {
    for (int x = 0; x < width; x++)
        if (format == DDX_VIDEO_GREY16)
            to[x] = from[2 * x + 1];
        else
            to[x] = (uint8_t)((77 * from[3 * x] + 150 * from[3 * x + 1] + 29 * from[3 * x + 2] + 128) >> 8);
}

static void luma_free(struct luma *luma) {
    free(luma->made);
    luma->made = NULL;
    luma->size = 0;
}

/* The luminance of a picture, valid as long as the picture and until the next call. 0, -ENOMEM. */
static int luma_of(struct luma *luma, const struct ddxvideo_picture *picture) {
    const struct ddxvideo_geometry *geometry = &picture->geometry;
    size_t width = (size_t)geometry->width, size = width * (size_t)geometry->height;

    luma->at = picture->plane[0];
    luma->stride = picture->stride[0];
    if (geometry->format != DDX_VIDEO_GREY16 && geometry->format != DDX_VIDEO_RGB24)
        return 0;
    if (luma->size != size) {
        luma_free(luma);
        luma->made = malloc(size);
        if (!luma->made)
            return -ENOMEM;
        luma->size = size;
    }
    for (int y = 0; y < geometry->height; y++)
        make_row(geometry->format, picture->plane[0] + (long)y * picture->stride[0], geometry->width,
                 luma->made + (size_t)y * width);
    luma->at = luma->made;
    luma->stride = geometry->width;
    return 0;
}

void luma_levels(int range, uint8_t level[256]) {
    for (int i = 0; i < 256; i++) {
        int full = (i - 16) * 255 / 219;

        level[i] = (uint8_t)(range != DDX_VIDEO_RANGE_LIMITED ? i : full < 0 ? 0 : full > 255 ? 255 : full);
    }
}

/* ---- Pairs ---- */

#define WINDOW_NS (20 * MS)   /* used if the frame rate is unknown */
#define PARTNER_NS (200 * MS) /* plus two frame periods: a frame waits this long for the other camera */
#define STRANGE_NS SECOND     /* if times differ by more than this, neither frame waits */
#define PATIENCE_NS SECOND    /* after this time without a pair, and FRAMES_UNPAIRED frames, a line reports it */
#define FRAMES_UNPAIRED 6     /* frames given up in a row: a slow machine gives up fewer */

bool source_open(struct source *source, DDX_STORE_ID *id) {
    source->items = source->name[1] ? 2 : 1;
    source->last_pair = ddx_time_now();
    for (int i = 0; i < source->items; i++) {
        struct source_item *item = &source->item[i];

        item->name = source->name[i];
        item->item = program_await(id, item->name, source->book);
        if (!item->item)
            return false;
        item->awaited = !*ddx_store_item_type(item->item);
    }
    return true;
}

static void release(struct source_item *item) {
    if (item->held)
        ddx_store_release(item->item);
    item->held = false;
}

void source_give(struct source *source) {
    for (int i = 0; i < source->items; i++)
        release(&source->item[i]);
}

void source_close(struct source *source) {
    for (int i = 0; i < source->items; i++) {
        luma_free(&source->item[i].luma);
        ddx_store_done_item(source->item[i].item);
    }
}

static void give_up(struct source *source, struct source_item *item) {
    ddx_stats_lost(source->book, LOST_PAIR, 1);
    release(item);
    source->unpaired++;
}

void source_end(struct source *source) {
    for (int i = 0; i < source->items; i++)
        if (source->item[i].held)
            give_up(source, &source->item[i]);
}

static void count(struct source *source, uint64_t frames, uint64_t missed, uint64_t sequence) {
    ddx_stats_in(source->book, frames, source->items == 1 ? sequence : 0);
    ddx_stats_lost(source->book, source->unpaired ? LOST_PAIR : LOST_LATE, missed);
}

/* Called after the first read, which may have given a frame: frames count from the moment that the item was awaited. */
static void begin(struct source *source, struct source_item *item, const struct ddx_frame *frame) {
    uint64_t seen = ddx_store_seen(item->item), from = frame ? seen - frame->missed - 1 : seen;
    uint64_t before = item->awaited ? from : 0;

    item->begun = true;
    if (source->items == 1)
        ddx_stats_follow(source->book, from - before);
    if (before)
        count(source, before, before, from);
}

/* Holds the newest unseen frame of an item. */
static int take_frame(struct source *source, struct source_item *item, double wait) {
    if (item->held)
        return 0;
    int error = ddx_store_acquire(item->item, &item->frame, item->begun ? wait : 0, DDX_NEXT);
    if (!item->begun && (!error || error == -ETIMEDOUT))
        begin(source, item, error ? NULL : &item->frame);
    if (error)
        return error == -ETIMEDOUT ? -EAGAIN : error;
    count(source, item->frame.missed + 1, item->frame.missed, item->frame.sequence);
    item->held = true;
    error = ddxvideo_view_any(item->item, item->frame.data, &item->picture);
    if (!error)
        error = luma_of(&item->luma, &item->picture);
    if (error) {
        ddx_stats_lost(source->book, LOST_PICTURE, 1);
        release(item);
        return error == -EBADMSG ? -EAGAIN : error;
    }
    item->time = item->picture.stamp.time ? item->picture.stamp.time : item->frame.time;
    return 0;
}

/* Half a frame period. */
static int64_t window_of(const struct ddxvideo_geometry *geometry) {
    return geometry->rate_num ? SECOND * geometry->rate_den / geometry->rate_num / 2 : WINDOW_NS;
}

/* Whether the frames are a pair; if not, at least one of them is given up. */
static bool match_frames(struct source *source) {
    struct source_item *left = &source->item[LEFT], *right = &source->item[RIGHT];
    int64_t apart = left->time - right->time;
    int64_t window = source->window ? source->window : window_of(&left->picture.geometry);

    if (llabs(apart) <= window)
        return true;
    bool strange = llabs(apart) > STRANGE_NS;
    if (apart < 0 || strange)
        give_up(source, left);
    if (apart > 0 || strange)
        give_up(source, right);
    return false;
}

/* Reports in one line that there are no pairs although a camera gives frames, and in one line their return. */
static void tell(struct source *source, bool pair) {
    int64_t now = ddx_time_now();

    if (pair && source->said)
        say("%s, %s: pairs again after %.1f s", source->name[0], source->name[1],
            (double)(now - source->last_pair) / 1e9);
    if (pair) {
        source->last_pair = now;
        source->said = false;
    } else if (source->unpaired >= FRAMES_UNPAIRED && !source->said && now - source->last_pair > PATIENCE_NS) {
        say("%s, %s: no frames of the same time, waiting for them", source->name[0], source->name[1]);
        source->said = true;
    }
}

/* Whether a frame has waited long enough for the other camera, by the frame rate. */
static void give_up_old(struct source *source) {
    int64_t now = ddx_time_now();

    for (int i = 0; i < 2; i++) {
        struct source_item *item = &source->item[i];

        if (item->held && now - item->frame.time > PARTNER_NS + 4 * window_of(&item->picture.geometry))
            give_up(source, item);
    }
}

/* Holds a frame of each item; -EAGAIN: not yet. Waits for one item only: the right one if a left frame is held. */
static int take_both(struct source *source, double wait, const char **at) {
    int wait_for = source->item[LEFT].held, error = 0;

    for (int i = 0; i < 2; i++) {
        struct source_item *item = &source->item[(wait_for + i) % 2];
        int result = take_frame(source, item, i ? 0 : wait);

        *at = item->name;
        if (result && result != -EAGAIN)
            return result;
        error = result ? result : error;
    }
    return error;
}

static int take_two(struct source *source, double wait, const char **at) {
    int error = take_both(source, wait, at);

    if (error && error != -EAGAIN)
        return error;
    if (error)
        give_up_old(source);
    else if (!match_frames(source))
        error = -EAGAIN;
    tell(source, !error);
    return error;
}

static void describe(const struct source *source, struct pair *pair) {
    const struct source_item *left = &source->item[0], *right = &source->item[source->items - 1];

    *pair = (struct pair){.luma = {left->luma.at, right->luma.at},
                          .stride = {left->luma.stride, right->luma.stride},
                          .geometry = left->picture.geometry,
                          .stamp = left->picture.stamp,
                          .written = left->frame.time > right->frame.time ? left->frame.time : right->frame.time,
                          .frames = (unsigned)source->items};
    pair->stamp.time = left->time;
    if (source->items == 1) {
        pair->geometry.height /= pair->geometry.fields > 1 ? pair->geometry.fields : 1;
        pair->luma[source->top == LEFT ? RIGHT : LEFT] += left->luma.stride * pair->geometry.height;
    }
}

int source_take(struct source *source, double wait, struct pair *pair, const char **at) {
    *at = source->name[0];
    int error = source->items == 2 ? take_two(source, wait, at) : take_frame(source, &source->item[0], wait);

    if (error)
        return error;
    source->unpaired = 0;
    describe(source, pair);
    return 0;
}
