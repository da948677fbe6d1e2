/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* The video item: create, loan, publish, view. */
#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "ddxvideo.h"
#include "video_layout.h"

#define BOUND_STEP 64  /* bytes; bounds of planes are multiples of it */
#define LOOKS 4        /* at most */
#define TIGHT_NS 20000 /* at most between two reads of one clock, with a read of the other between them */

/* 32-bit and 64-bit programs share the item; no field may need padding on only one of them. */
_Static_assert(offsetof(DDX_VIDEO, y) == 16, "layout");
_Static_assert(offsetof(DDX_VIDEO, u) == 16 + DDX_VIDEO_MAX, "layout");
_Static_assert(offsetof(DDX_VIDEO, v) == 16 + DDX_VIDEO_MAX / 4 * 5, "layout");
_Static_assert(offsetof(DDX_VIDEO, time) == 16 + DDX_VIDEO_MAX / 2 * 3, "layout");
_Static_assert(offsetof(DDX_VIDEO, time) % 8 == 0, "layout");
_Static_assert(offsetof(DDX_VIDEO, rate_num) == offsetof(DDX_VIDEO, time) + 32, "layout");
_Static_assert(sizeof(DDX_VIDEO) == offsetof(DDX_VIDEO, time) + 80, "layout");
_Static_assert(DDX_VIDEO_MAX % BOUND_STEP == 0, "keeps what follows the planes aligned");

#define TEXT_(...) #__VA_ARGS__
#define TEXT(...) TEXT_(__VA_ARGS__)
static const char declaration_pattern[] = TEXT(DDX_VIDEO_STRUCT_(SAMPLE, LUMA, CHROMA));

const char *ddxvideo_geometry_error(const struct ddxvideo_geometry *g) {
    if (g->width <= 0 || g->height <= 0)
        return "width or height is zero";
    if (g->width > DDX_VIDEO_SIDE || g->height > DDX_VIDEO_SIDE)
        return "larger than 8192x8192";
    const struct video_layout *layout = video_layout_of(g->format);
    if (!layout)
        return "unknown format";
    bool even_width = layout->chroma_x == 1, even_height = layout->chroma_y == 1;
    if (even_height && (g->width % 2 || g->height % 2))
        return "4:2:0 needs an even width and height";
    if (even_width && g->width % 2)
        return "4:2:2 needs an even width";
    if (g->fields < 1 || g->fields > DDX_VIDEO_FIELDS || g->height % (g->fields << even_height))
        return even_height ? "the fields do not divide the height into even parts"
                           : "the fields do not divide the height";
    if (g->rate_num < 0 || g->rate_den < 0 || !g->rate_num != !g->rate_den)
        return "bad frame rate";
    if (g->aspect_num < 0 || g->aspect_den < 0 || !g->aspect_num != !g->aspect_den)
        return "bad pixel aspect";
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

/* The declaration with its words SAMPLE, LUMA and CHROMA replaced. */
static void declare(char *text, size_t size, const char *sample, unsigned luma, unsigned chroma) {
    char numbers[2][12];
    const char *const words[][2] = {{"SAMPLE", sample}, {"LUMA", numbers[0]}, {"CHROMA", numbers[1]}};
    const size_t count = sizeof words / sizeof *words;
    size_t length = 0;

    snprintf(numbers[0], sizeof numbers[0], "%u", luma);
    snprintf(numbers[1], sizeof numbers[1], "%u", chroma);
    for (const char *from = declaration_pattern; *from && length + 16 < size;) {
        size_t i = 0;

        while (i < count && strncmp(from, words[i][0], strlen(words[i][0])) != 0)
            i++;
        if (i == count) {
            text[length++] = *from++;
            continue;
        }
        length += (size_t)snprintf(text + length, size - length, "%s", words[i][1]);
        from += strlen(words[i][0]);
    }
    text[length] = 0;
}

/* Bytes that the struct has for a plane. Every 4:2:0 picture of up to DDX_VIDEO_MAX has the same struct. */
static unsigned bound_of(const struct video_layout *layout, unsigned bytes, int plane) {
    unsigned least = video_layout_is_420(layout->format) ? (plane ? DDX_VIDEO_MAX / 4 : DDX_VIDEO_MAX) : BOUND_STEP;

    return bytes <= least ? least : (bytes + BOUND_STEP - 1) / BOUND_STEP * BOUND_STEP;
}

int ddxvideo_create(DDX_STORE_ID *id, const char *name, const struct ddxvideo_geometry *geometry,
                    DDX_STORE_ITEM **item) {
    if (ddxvideo_geometry_error(geometry))
        return -EINVAL;
    const struct video_layout *layout = video_layout_of(geometry->format);
    unsigned used[2], bound[2], sample = (unsigned)layout->bytes;
    for (int plane = 0; plane < 2; plane++) {
        int stride, rows;

        video_layout_plane(layout, geometry->width, geometry->height, plane, &stride, &rows);
        used[plane] = (unsigned)stride * (unsigned)rows;
        bound[plane] = bound_of(layout, used[plane], plane);
    }
    char declaration[sizeof declaration_pattern + 64];
    declare(declaration, sizeof declaration, layout->sample, bound[0] / sample, bound[1] / sample);
    const struct ddx_extent extents[] = {{"y", used[0]}, {"u", used[1]}, {"v", used[1]}};
    const struct ddx_item_spec spec = {.name = name,
                                       .type = "DDX_VIDEO",
                                       .declaration = declaration,
                                       .size = sizeof(DDX_VIDEO) - DDX_VIDEO_MAX / 2 * 3 + bound[0] + 2 * bound[1],
                                       .extents = extents,
                                       .extent_count = 3};
    return ddx_store_create(id, &spec, item);
}

/* A number beside the planes: its place in our structs, and its name in the item. */
struct number {
    const char *name;
    size_t offset;
    unsigned bytes;
    bool paper; /* one of the paper's fields: required */
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

/* The field of a number, or NULL if the item has no matching one. */
static const struct ddx_field *find_field(const DDX_STORE_ITEM *item, const struct number *number) {
    const struct ddx_field *field = ddx_store_field_named(item, number->name);

    return field && field->kind == DDX_KIND_INT && field->bytes == number->bytes && field->count == 1 ? field : NULL;
}

static bool get_numbers(const DDX_STORE_ITEM *item, const void *data, const struct number *numbers, void *to) {
    for (const struct number *number = numbers; number->name; number++) {
        const struct ddx_field *field = find_field(item, number);

        if (field)
            memcpy((char *)to + number->offset, (const char *)data + field->offset, number->bytes);
        else if (number->paper)
            return false;
    }
    return true;
}

static void set_numbers(const DDX_STORE_ITEM *item, void *data, const struct number *numbers, const void *from) {
    for (const struct number *number = numbers; number->name; number++) {
        const struct ddx_field *field = find_field(item, number);

        if (field)
            memcpy((char *)data + field->offset, (const char *)from + number->offset, number->bytes);
    }
}

/* Whether a field can hold samples of this layout. The paper's programs may write any type of one byte. */
static bool holds(const struct ddx_field *field, const struct video_layout *layout) {
    return field->bytes == (uint32_t)layout->bytes &&
           (field->kind == DDX_KIND_UNSIGNED || video_layout_is_420(layout->format));
}

/*
 * Where the planes of this (checked) geometry lie in the item. -EPROTOTYPE if it has no planes at all, -EBADMSG if they
 * have other samples, -EMSGSIZE if they are smaller than those of the geometry.
 */
static int find_planes(const DDX_STORE_ITEM *item, const struct ddxvideo_geometry *geometry, uint64_t offset[3],
                       int stride[3], int rows[3]) {
    static const char *const names[3] = {"y", "u", "v"};
    const struct video_layout *layout = video_layout_of(geometry->format);

    for (int i = 0; i < 3; i++) {
        const struct ddx_field *field = ddx_store_field_named(item, names[i]);

        if (!field || field->bytes > 2)
            return -EPROTOTYPE;
        if (!holds(field, layout))
            return -EBADMSG;
        video_layout_plane(layout, geometry->width, geometry->height, i, &stride[i], &rows[i]);
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
        return error == -EBADMSG ? -EPROTOTYPE : error;
    }
    for (int i = 0; i < 3; i++)
        frame->plane[i] = frame->rows[i] ? (unsigned char *)frame->data + offset[i] : NULL;
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

int ddxvideo_view_any(const DDX_STORE_ITEM *item, const void *data, struct ddxvideo_picture *view) {
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
        view->plane[i] = view->rows[i] ? (const unsigned char *)data + offset[i] : NULL;
    return 0;
}

int ddxvideo_view(const DDX_STORE_ITEM *item, const void *data, struct ddxvideo_picture *view) {
    int error = ddxvideo_view_any(item, data, view);

    return !error && !video_layout_is_420(view->geometry.format) ? -EPROTOTYPE : error;
}

int64_t ddxvideo_wall_offset(void) {
    int64_t offset = 0, tightest = INT64_MAX;

    for (int look = 0; look < LOOKS && tightest > TIGHT_NS; look++) { /* again if an interruption came between */
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

/* ---- The items beside a video item ---- */

_Static_assert(sizeof(DDX_VIDEO_PARAMETERS) == 4 + 56 * DDX_VIDEO_PARAMETERS_MAX, "layout");

static int create_beside(DDX_STORE_ID *id, const char *video_name, const char *suffix, struct ddx_item_spec *spec,
                         DDX_STORE_ITEM **item) {
    char name[DDX_NAME_MAX + 1];
    int length = snprintf(name, sizeof name, "%s.%s", video_name, suffix);

    if (length < 0 || (size_t)length >= sizeof name)
        return -EINVAL;
    spec->name = name;
    return ddx_store_create(id, spec, item);
}

int ddxvideo_counter_create(DDX_STORE_ID *id, const char *video_name, DDX_STORE_ITEM **item) {
    struct ddx_item_spec spec = {.type = "int", .declaration = "int", .size = sizeof(int)};

    return create_beside(id, video_name, "frame", &spec, item);
}

int ddxvideo_counter_write(DDX_STORE_ITEM *item, int frame) {
    return ddx_store_write(item, &frame, NULL);
}

int ddxvideo_parameters_create(DDX_STORE_ID *id, const char *video_name, DDX_STORE_ITEM **item) {
    struct ddx_item_spec spec = {.type = "DDX_VIDEO_PARAMETERS", .size = sizeof(DDX_VIDEO_PARAMETERS)};

    return create_beside(id, video_name, "parameters", &spec, item);
}

int ddxvideo_parameters_write(DDX_STORE_ITEM *item, const DDX_VIDEO_PARAMETERS *parameters) {
    if (parameters->count < 0 || parameters->count > DDX_VIDEO_PARAMETERS_MAX)
        return -EINVAL;
    for (int i = 0; i < parameters->count; i++)
        if (!memchr(parameters->parameter[i].name, 0, sizeof parameters->parameter[i].name))
            return -EINVAL;
    return ddx_store_write(item, parameters, NULL);
}

int ddxvideo_stereo_create(DDX_STORE_ID *id, const char *video_name, DDX_STORE_ITEM **item) {
    struct ddx_item_spec spec = {.type = "DDX_VIDEO_STEREO", .size = sizeof(DDX_VIDEO_STEREO)};

    return create_beside(id, video_name, "stereo", &spec, item);
}
