/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "range.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LOOK INT64_C(1000000000) /* ns; how often to look for the items */
#define STEPS 16.0               /* of a disparity, in a pixel */

struct range {
    DDX_STORE_ID *id;
    char name[DDX_NAME_MAX + 16];
    size_t length; /* of a message with the item's name */
    DDX_STORE_ITEM *disparity, *stereo;
    bool begun; /* a value has come, so earlier writes were seen */
    int64_t looked;
};

struct range *range_open(DDX_STORE_ID *id, const char *name) {
    struct range *range = calloc(1, sizeof *range);

    if (!range)
        return NULL;
    range->id = id;
    range->length = (size_t)snprintf(range->name, sizeof range->name, "%s", name);
    return range;
}

static void let_go(struct range *range) {
    ddx_store_done_item(range->disparity);
    ddx_store_done_item(range->stereo);
    range->disparity = range->stereo = NULL;
    range->begun = false;
}

void range_close(struct range *range) {
    if (!range)
        return;
    let_go(range);
    free(range);
}

static DDX_STORE_ITEM *find(struct range *range, const char *suffix) {
    snprintf(range->name + range->length, sizeof range->name - range->length, "%s", suffix);
    return ddx_store_lookup_item(range->id, range->name, NULL, 0);
}

static bool is_there(struct range *range) {
    int64_t now = ddx_time_now();

    if (range->disparity)
        return true;
    if (now - range->looked < LOOK)
        return false;
    range->looked = now;
    range->disparity = find(range, ".disparity");
    range->stereo = range->disparity ? find(range, ".stereo") : NULL;
    if (!range->stereo)
        let_go(range);
    return range->stereo;
}

/* ---- Fields of the items, by name, of any numeric type ---- */

static double number(const DDX_STORE_ITEM *item, const void *data, const char *name) {
    const struct ddx_field *field = ddx_store_field_named(item, name);
    const char *at = field ? (const char *)data + field->offset : NULL;
    double real = 0;
    float single = 0;
    int whole = 0;

    if (field && field->kind == DDX_KIND_FLOAT && field->bytes == sizeof real)
        memcpy(&real, at, sizeof real);
    else if (field && field->kind == DDX_KIND_FLOAT && field->bytes == sizeof single)
        memcpy(&single, at, sizeof single);
    else if (field && field->kind == DDX_KIND_INT && field->bytes == sizeof whole)
        memcpy(&whole, at, sizeof whole);
    return real + (double)single + whole;
}

/* The disparities of a frame, without f and T. NULL if the item has none. */
static struct shot_depth *copy(const DDX_STORE_ITEM *item, const void *data) {
    double width = number(item, data, "width"), height = number(item, data, "height");
    const struct ddx_field *samples = ddx_store_field_named(item, "y");

    if (!samples || samples->bytes != sizeof(uint16_t) || width < 1 || height < 1 || width > DDX_VIDEO_SIDE ||
        height > DDX_VIDEO_SIDE || width * height * sizeof(uint16_t) > (double)samples->used)
        return NULL;
    size_t bytes = (size_t)(width * height) * sizeof(uint16_t);
    struct shot_depth *depth = malloc(sizeof *depth + bytes);
    if (!depth)
        return NULL;
    *depth = (struct shot_depth){.width = (int)width, .height = (int)height};
    memcpy(depth->disparity, (const char *)data + samples->offset, bytes);
    return depth;
}

static bool calibrate(struct range *range, struct shot_depth *depth) {
    struct ddx_frame frame;

    if (ddx_store_acquire(range->stereo, &frame, 0, DDX_CURRENT))
        return false;
    depth->focal = number(range->stereo, frame.data, "f");
    depth->base = number(range->stereo, frame.data, "T");
    ddx_store_release(range->stereo);
    return true;
}

void range_take(struct range *range, struct history *history) {
    struct ddx_frame frame;

    while (is_there(range) && !ddx_store_acquire(range->disparity, &frame, 0, range->begun ? DDX_NEXT : DDX_CURRENT)) {
        range->begun = true;
        struct shot_depth *depth = copy(range->disparity, frame.data);
        int of = (int)number(range->disparity, frame.data, "frame");

        ddx_store_release(range->disparity);
        if (depth && calibrate(range, depth))
            history_depth(history, of, depth);
        else
            free(depth);
    }
}

double range_metres(const struct shot_depth *depth, int column, int row, int width, int height) {
    int x = (int)((int64_t)column * depth->width / width), y = (int)((int64_t)row * depth->height / height);
    double disparity = depth->disparity[(size_t)y * (size_t)depth->width + (size_t)x] / STEPS;

    return disparity > 0 ? depth->focal * depth->base / disparity : 0;
}
