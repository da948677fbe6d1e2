/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* The video item: create, loan, publish, view. */
#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "ddxvideo.h"

#define LOOKS 4
#define TIGHT_NS 20000 /* between two looks at one clock, with one at the other in the midst */

/* 32-bit and 64-bit programs share the item; no field may need padding on only one of them. */
_Static_assert(offsetof(DDX_VIDEO, y) == 16, "layout");
_Static_assert(offsetof(DDX_VIDEO, u) == 16 + DDX_VIDEO_MAX, "layout");
_Static_assert(offsetof(DDX_VIDEO, v) == 16 + DDX_VIDEO_MAX / 4 * 5, "layout");
_Static_assert(offsetof(DDX_VIDEO, time) == 16 + DDX_VIDEO_MAX / 2 * 3, "layout");
_Static_assert(offsetof(DDX_VIDEO, time) % 8 == 0, "layout");
_Static_assert(offsetof(DDX_VIDEO, rate_num) == offsetof(DDX_VIDEO, time) + 32, "layout");
_Static_assert(sizeof(DDX_VIDEO) == offsetof(DDX_VIDEO, time) + 80, "layout");
_Static_assert(DDX_VIDEO_MAX % 64 == 0, "keeps what follows the planes aligned");

#define TEXT_(...) #__VA_ARGS__
#define TEXT(...) TEXT_(__VA_ARGS__)
#define BOUND_WORD "BOUND"
static const char declaration_pattern[] = TEXT(DDX_VIDEO_STRUCT_(BOUND));

const char *ddxvideo_geometry_error(const struct ddxvideo_geometry *g) {
    if (g->width <= 0 || g->height <= 0)
        return "width or height is zero";
    if (g->width > DDX_VIDEO_SIDE || g->height > DDX_VIDEO_SIDE)
        return "larger than 8192x8192";
    if (g->width % 2 || g->height % 2)
        return "4:2:0 needs an even width and height";
    if (g->fields < 1 || g->fields > DDX_VIDEO_FIELDS || g->height % (2 * g->fields))
        return "the fields do not divide the height into even parts";
    if (g->rate_num < 0 || g->rate_den < 0 || !g->rate_num != !g->rate_den)
        return "bad frame rate";
    if (g->aspect_num < 0 || g->aspect_den < 0 || !g->aspect_num != !g->aspect_den)
        return "bad pixel aspect";
    if (g->format < DDX_VIDEO_420 || g->format > DDX_VIDEO_420_PALDV)
        return "unknown format";
    if (g->interlacing && (g->interlacing < 0 || g->interlacing > 127 || !strchr("?ptbm", g->interlacing)))
        return "unknown interlacing";
    if (g->range < DDX_VIDEO_RANGE_UNKNOWN || g->range > DDX_VIDEO_RANGE_FULL)
        return "unknown range";
    return NULL;
}

int ddxvideo_rate_known(int rate_num, int rate_den) {
    return rate_num > 0 && rate_den > 0 && rate_num <= (int64_t)rate_den * DDX_VIDEO_RATE;
}

int ddxvideo_same_layout(const struct ddxvideo_geometry *a, const struct ddxvideo_geometry *b) {
    return a->width == b->width && a->height == b->height && a->fields == b->fields && a->format == b->format &&
           a->interlacing == b->interlacing && a->range == b->range;
}

/* The declaration with its word BOUND replaced by a number. */
static void declare(char *text, size_t size, unsigned bound) {
    size_t length = 0;

    for (const char *from = declaration_pattern; *from && length + 16 < size;) {
        if (!strncmp(from, BOUND_WORD, sizeof BOUND_WORD - 1)) {
            length += (size_t)snprintf(text + length, size - length, "%u", bound);
            from += sizeof BOUND_WORD - 1;
        } else {
            text[length++] = *from++;
        }
    }
    text[length] = 0;
}

int ddxvideo_create(DDX_STORE_ID *id, const char *name, const struct ddxvideo_geometry *geometry,
                    DDX_STORE_ITEM **item) {
    if (ddxvideo_geometry_error(geometry))
        return -EINVAL;
    unsigned luma = (unsigned)geometry->width * (unsigned)geometry->height;
    unsigned bound = luma <= DDX_VIDEO_MAX ? DDX_VIDEO_MAX : (luma + 63) / 64 * 64;
    char declaration[sizeof declaration_pattern + 64];
    declare(declaration, sizeof declaration, bound);
    const struct ddx_extent extents[] = {{"y", luma}, {"u", luma / 4}, {"v", luma / 4}};
    const struct ddx_item_spec spec = {.name = name,
                                       .type = "DDX_VIDEO",
                                       .declaration = declaration,
                                       .size = sizeof(DDX_VIDEO) - DDX_VIDEO_MAX / 2 * 3 + bound / 2 * 3,
                                       .extents = extents,
                                       .extent_count = 3};
    return ddx_store_create(id, &spec, item);
}

/* One number beside the planes: where it is kept in our structs, and its name in the item. */
struct number {
    const char *name;
    size_t offset;
    unsigned bytes;
    bool paper; /* one of the paper's fields: no video without it */
};
#define GEOMETRY(field) offsetof(struct ddxvideo_geometry, field), sizeof(int)

static const struct number geometry_numbers[] = {
    {"fields", GEOMETRY(fields), true},
    {"width", GEOMETRY(width), true},
    {"height", GEOMETRY(height), true},
    {"rate_num", GEOMETRY(rate_num), false},
    {"rate_den", GEOMETRY(rate_den), false},
    {"aspect_num", GEOMETRY(aspect_num), false},
    {"aspect_den", GEOMETRY(aspect_den), false},
    {"format", GEOMETRY(format), false},
    {"interlacing", GEOMETRY(interlacing), false},
    {"range", GEOMETRY(range), false},
    {NULL, 0, 0, false},
};
#define STAMP(field) offsetof(struct ddxvideo_stamp, field), sizeof(((struct ddxvideo_stamp *)0)->field)
static const struct number stamp_numbers[] = {
    {"frame", STAMP(frame), true},
    {"time", STAMP(time), false},
    {"wall_offset", STAMP(wall_offset), false},
    {"source_sequence", STAMP(source_sequence), false},
    {"source_lost", STAMP(source_lost), false},
    {NULL, 0, 0, false},
};

/* The field of a number, or NULL if the item has none that looks like it. */
static const struct ddx_field *find(const DDX_STORE_ITEM *item, const struct number *number) {
    const struct ddx_field *field = ddx_store_field_named(item, number->name);

    return field && field->kind == DDX_KIND_INT && field->bytes == number->bytes && field->count == 1 ? field : NULL;
}

static bool get_numbers(const DDX_STORE_ITEM *item, const void *data, const struct number *numbers, void *to) {
    for (const struct number *number = numbers; number->name; number++) {
        const struct ddx_field *field = find(item, number);

        if (field)
            memcpy((char *)to + number->offset, (const char *)data + field->offset, number->bytes);
        else if (number->paper)
            return false;
    }
    return true;
}

static void set_numbers(const DDX_STORE_ITEM *item, void *data, const struct number *numbers, const void *from) {
    for (const struct number *number = numbers; number->name; number++) {
        const struct ddx_field *field = find(item, number);

        if (field)
            memcpy((char *)data + field->offset, (const char *)from + number->offset, number->bytes);
    }
}

/* Where the planes of this (checked) geometry lie in the item; -EMSGSIZE if they are larger than the item's. */
static int find_planes(const DDX_STORE_ITEM *item, const struct ddxvideo_geometry *geometry, uint64_t offset[3],
                       int stride[3], int rows[3]) {
    static const char *const names[3] = {"y", "u", "v"};

    for (int i = 0; i < 3; i++) {
        const struct ddx_field *field = ddx_store_field_named(item, names[i]);

        if (!field || field->bytes != 1)
            return -EPROTOTYPE;
        stride[i] = i ? geometry->width / 2 : geometry->width;
        rows[i] = i ? geometry->height / 2 : geometry->height;
        if ((uint64_t)stride[i] * (uint64_t)rows[i] > field->used)
            return -EMSGSIZE;
        offset[i] = field->offset;
    }
    return 0;
}

int ddxvideo_loan(DDX_STORE_ITEM *item, const struct ddxvideo_geometry *geometry, struct ddxvideo_frame *frame) {
    uint64_t offset[3];

    if (ddxvideo_geometry_error(geometry))
        return -EINVAL;
    memset(frame, 0, sizeof *frame);
    frame->geometry = *geometry;
    int error = ddx_store_loan(item, &frame->data);
    if (error)
        return error;
    error = find_planes(item, geometry, offset, frame->stride, frame->rows);
    if (error) {
        ddx_store_cancel(item);
        return error;
    }
    for (int i = 0; i < 3; i++)
        frame->plane[i] = (unsigned char *)frame->data + offset[i];
    return 0;
}

int ddxvideo_publish(DDX_STORE_ITEM *item, const struct ddxvideo_frame *frame) {
    set_numbers(item, frame->data, geometry_numbers, &frame->geometry);
    set_numbers(item, frame->data, stamp_numbers, &frame->stamp);
    const struct ddx_field *reserved = ddx_store_field_named(item, "reserved");
    if (reserved)
        memset((char *)frame->data + reserved->offset, 0, (size_t)reserved->used);
    return ddx_store_publish(item, NULL);
}

int ddxvideo_view(const DDX_STORE_ITEM *item, const void *data, struct ddxvideo_picture *view) {
    uint64_t offset[3];

    memset(view, 0, sizeof *view);
    if (!get_numbers(item, data, geometry_numbers, &view->geometry) ||
        !get_numbers(item, data, stamp_numbers, &view->stamp))
        return -EPROTOTYPE;
    if (ddxvideo_geometry_error(&view->geometry))
        return -EBADMSG;
    if (!ddxvideo_rate_known(view->geometry.rate_num, view->geometry.rate_den))
        view->geometry.rate_num = view->geometry.rate_den = 0;
    int error = find_planes(item, &view->geometry, offset, view->stride, view->rows);
    if (error)
        return error == -EMSGSIZE ? -EBADMSG : error;
    for (int i = 0; i < 3; i++)
        view->plane[i] = (const unsigned char *)data + offset[i];
    return 0;
}

int64_t ddxvideo_wall_offset(void) {
    int64_t offset = 0, tightest = INT64_MAX;

    for (int look = 0; look < LOOKS && tightest > TIGHT_NS; look++) { /* who is interrupted between them, looks again */
        struct timespec wall;
        int64_t before = ddx_time_now();
        clock_gettime(CLOCK_REALTIME, &wall);
        int64_t after = ddx_time_now();
        if (after - before < tightest) {
            tightest = after - before;
            offset = wall.tv_sec * INT64_C(1000000000) + wall.tv_nsec - (before + tightest / 2);
        }
    }
    return offset;
}
